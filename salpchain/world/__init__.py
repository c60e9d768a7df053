"""What is around a chain: its dynamics, the water, its thrusters, obstacles, and what it senses."""
