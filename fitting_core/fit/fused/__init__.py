"""The objective of single frames compiled to machine code: the same numbers as in torch, several times faster.

`terms` and `objective` are the reference, and the way on a GPU. What the kernels know of them says `known.KNOWN`; what
they do not know is evaluated in torch and added, term by term.
"""
