"""Bridges to other people's tools: each thin, optional, imported only when asked for."""

FORMATS = {"onnx": ".onnx", "torch": ".safetensors"}  # of exported policies, with their suffixes
