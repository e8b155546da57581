"""The objective of single frames compiled to machine code: the same numbers as in torch, several times faster.

`terms` and `objective` are the reference, and used on a GPU. Terms bring their kernels with them
(`terms.entry.Kernel`); terms without one are evaluated in torch and added.
"""
