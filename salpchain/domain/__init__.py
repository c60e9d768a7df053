"""The Salp Chain Locomotion Domain: a chain must take a target pose."""
