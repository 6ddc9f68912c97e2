"""Builds the wheel: fetches MuJoCo and the model files, puts them into the package, and lets maturin do the rest.

Run by pip and other builders, which read `[build-system]` in pyproject.toml.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import maturin
from maturin import build_sdist, get_requires_for_build_sdist  # noqa: F401 (hooks)

CHECKOUT = Path(__file__).resolve().parents[2]
NATIVE = CHECKOUT / ".native"
PACKAGE = CHECKOUT / "crates" / "hksl-py" / "python" / "hksl" / "native"
LIBRARY = "libmujoco.so.3.17.0"


def _carry_native_files():
    """Copies library and models, as `make setup` fetched and checked them, into the package."""
    subprocess.run([str(CHECKOUT / "scripts" / "fetch-native.sh")], check=True, stdout=sys.stderr)
    shutil.rmtree(PACKAGE, ignore_errors=True)
    PACKAGE.mkdir()
    shutil.copy2(NATIVE / "mujoco" / LIBRARY, PACKAGE / LIBRARY)
    shutil.copytree(NATIVE / "models", PACKAGE / "models")


def _with_features(config_settings):
    """`HKSL_FEATURES=cuda pip install .` builds with that feature."""
    features = os.environ.get("HKSL_FEATURES")
    if not features:
        return config_settings
    return {**(config_settings or {}), "build-args": f"--features {features}"}


def get_requires_for_build_wheel(config_settings=None):
    return maturin.get_requires_for_build_wheel(config_settings)


def get_requires_for_build_editable(config_settings=None):
    return maturin.get_requires_for_build_editable(config_settings)


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    return maturin.prepare_metadata_for_build_wheel(metadata_directory, config_settings)


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    _carry_native_files()
    return maturin.build_wheel(wheel_directory, _with_features(config_settings), metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    _carry_native_files()
    return maturin.build_editable(wheel_directory, _with_features(config_settings), metadata_directory)
