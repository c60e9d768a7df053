"""The live page: a world that people can touch, its server, and the page."""
