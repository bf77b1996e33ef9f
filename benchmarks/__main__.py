"""Runs a study by its name: python benchmarks NAME [OPTION ...]; without a name it lists them.

As Python runs this folder, its modules find each other by the folders' names.
"""

import importlib
import sys

STUDIES = {
    "accuracy": ("accuracy.study", "errors of refined poses, and of other trackers"),
    "real_images": ("accuracy.real_images", "poses found in the real images of a cube"),
    "acquisition": ("acquisition.study", "how soon and surely a target is found from nothing"),
    "targets": ("acquisition.targets", "how well the solids in models/ are tracked and found"),
    "confidence": ("confidence.study", "how reliable the confidence is; --fit for its weights"),
    "robustness": ("robustness", "what disturbances do to the robust tracker"),
    "servoing": ("servoing", "the closed loop: steps, lag, stability, troubles"),
    "performance": ("speed.report", "what everything costs, in time and memory"),
}
"""Name, which is its page's in docs/studies, too: its module, and what it measures."""

CHECKS = {
    "kills": ("kills", "whether commands that are ended anywhere lose or break anything"),
    "scale": ("scale", "what thousands of runs on a cluster cost beside their simulation"),
}
"""The same, without a page."""


def main() -> int:
    """Runs the study that the command line names."""
    name, *options = sys.argv[1:] or ["--help"]
    known = STUDIES | CHECKS
    if name in known:
        module, _ = known[name]
        sys.argv = [f"benchmarks {name}", *options]
        importlib.import_module(module).main()
        return 0
    print("python benchmarks NAME [--help]\n")
    print("\n".join(f"  {name:<14}{measures}" for name, (_, measures) in known.items()))
    return 0 if name in ("-h", "--help") else 2


# Worker processes import what started them.
if __name__ == "__main__":
    sys.exit(main())
