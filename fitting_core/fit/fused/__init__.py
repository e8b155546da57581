"""The objective of single frames compiled to machine code: the same numbers as in torch, several times faster.

`terms` and `objective` are the reference, and the way on a GPU. Terms bring their kernels with them
(`terms.entry.Kernel`); one without is evaluated in torch and added to the rest.
"""
