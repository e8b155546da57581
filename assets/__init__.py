"""Data that ship with tcfit (`fitting_core/shipped.py`), with where they come from beside them: nothing licensed to
others' terms only, nothing large."""
