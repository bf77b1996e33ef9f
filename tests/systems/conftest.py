"""Lets the tests import the helper module beside them, `stand_in`.

With ``--import-mode=importlib`` pytest leaves ``sys.path`` alone.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
