"""Stage one: a depth image and a goal in, five key points and a collision probability out.

`infer` runs in flight (ONNX Runtime, no torch); `networks` and `learning` need the `train` extra.
"""
