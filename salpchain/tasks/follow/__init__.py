"""The task `follow`: a target pose that moves along a smooth path."""
