"""Many runs: the paper's grid, on this machine or on a cluster."""
