"""Dynamics of robots that exist: what moves a chain in place of the paper's world in VMAS."""
