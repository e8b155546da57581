"""What pyproject.toml cannot say: the folder `assets` is installed as a part of fitting_core."""

from setuptools import find_namespace_packages, setup

setup(
    packages=[*find_namespace_packages(include=["fitting_core*", "tcfit_app*"]), "fitting_core.assets"],
    package_dir={"fitting_core.assets": "assets"},
)
