"""The paper's task, the Salp Chain Locomotion Domain: a chain must take a target pose."""
