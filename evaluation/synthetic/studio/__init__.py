"""Pictures of a generated clip: camera, stage, clothes and a rasterizer of its own."""
