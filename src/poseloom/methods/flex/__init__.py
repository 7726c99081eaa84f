"""Four flex sensors over knees and elbows: networks that run sample by sample through onnxruntime."""
