"""Dynamics of chains of units and links. Knows no task."""
