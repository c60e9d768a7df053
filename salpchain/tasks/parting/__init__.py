"""Tasks of chains that come apart and join: `dock`, `passage`, `gather`."""
