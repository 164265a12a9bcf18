"""OpenCL kernels: one .cl a pass, shared pieces in include/."""
