"""Tasks: what a chain is asked to do, what its units observe, what they are rewarded for."""
