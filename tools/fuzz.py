"""Tries the properties in tests/fuzz with many random cases: what no one thought of.

Usage: ``make fuzz``, ``make fuzz ARGS='--cases 100000'``, ``make fuzz ARGS='--bounds -k poses'``;
or ``python tools/fuzz.py``. What follows goes to pytest.

The normal tests try a few cases, always the same ones. Here they are others every time; the seed is
told, and ``--seed`` tries the same ones again. The last lines tell how many cases ran.
"""

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SILENT_S = 600  # of one property, after which it is told where it hangs


def main() -> int:
    """Returns pytest's exit status."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument(
        "--cases", type=int, default=1000, help="of each property; slow ones have fewer"
    )
    parser.add_argument("--seed", type=int, help="of the random cases")
    parser.add_argument(
        "--bounds", action="store_true", help="the compiled functions check every index"
    )
    options, pytest_options = parser.parse_known_args()
    if options.cases < 1:
        parser.error(f"--cases must be at least 1, not {options.cases}")
    seed = int.from_bytes(os.urandom(4)) if options.seed is None else options.seed
    environment = {**os.environ, "MFFDRAKE_FUZZ_CASES": str(options.cases)}
    if options.bounds:
        # Compiled without checks they must not be taken, nor be left for others with them; nor must
        # those that call what has changed since, which numba does not notice.
        sources = sorted((ROOT / "mffdrake" / "recognition").rglob("*.py"))
        state = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()
        cache = Path(tempfile.gettempdir(), f"mffdrake-bounds-{os.getuid()}-{state[:12]}")
        environment |= {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-m", "pytest", "tests/fuzz", f"--hypothesis-seed={seed}"]
    command += ["-n", "logical", "-o", f"faulthandler_timeout={SILENT_S}", *pytest_options]
    print(f"seed {seed}, {options.cases} cases of each property", flush=True)
    return subprocess.run(command, cwd=ROOT, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main())
