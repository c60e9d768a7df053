"""How large units and links are unless said otherwise: known without JAX, for what draws."""

UNIT_LENGTH = 0.04  # m, along the chain
UNIT_WIDTH = 0.05  # m, across the chain
LINK_LENGTH = 0.07  # m, between the centres of two units
