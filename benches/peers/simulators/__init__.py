"""The simulators that are installed, each of which can be measured."""

import importlib

PEERS = ("mujoco", "newton", "taichi")


def installed():
    """Modules of the peers by name, and why others are missing."""
    found, missing = {}, {}
    for name in PEERS:
        try:
            found[name] = importlib.import_module(f".{name}", __name__)
        except ImportError as error:
            missing[name] = str(error)
    return found, missing
