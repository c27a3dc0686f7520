"""A CUDA device without a GPU: Warp compiles kernels to PTX, which runs here thread by thread, translated to C.

`python -m tests.emulated_cuda [-m MODULE | SCRIPT] ...` runs a program with the device `cuda:0`. docs/contributing.md
says what it checks.
"""
