"""Trials of a controller on any length, and their statistics."""
