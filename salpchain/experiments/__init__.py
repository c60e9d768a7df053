"""Many runs: started, watched, retried and resumed, on this machine or on a cluster."""
