"""Training of the project's pose networks: `python -m ogg_rs.train --help`.

Needs PyTorch, NumPy, Pillow and tqdm; export also onnx and onnxruntime. Nothing here is needed to run the networks.
"""
