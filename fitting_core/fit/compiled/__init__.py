"""What compiled kernels of terms and objectives are made of: posed bodies, their derivatives, and small algebra."""
