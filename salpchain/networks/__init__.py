"""Graph networks: graphs over a chain, their layers, actor and critic."""
