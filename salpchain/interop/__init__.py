"""Bridges to other people's tools: each thin, optional, imported only when asked for."""
