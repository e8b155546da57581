"""Reading and writing keypoint files, one module per format, and choosing one person among all detected."""
