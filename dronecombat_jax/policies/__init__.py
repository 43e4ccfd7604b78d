"""One policy as one file: safetensors, ONNX, and a reader that needs NumPy alone.

What does not live here: which checkpoint it comes from (`runs`).
"""
