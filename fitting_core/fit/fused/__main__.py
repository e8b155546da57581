"""`python -m fitting_core.fit.fused`: compile the kernels now, as `make install` does."""

from fitting_core.fit.fused.ready import prepare, problem

prepare(print)
print(f"The solver's kernels are not used: {problem()}" if problem() else "The solver's kernels are ready.")
