"""The tests, and what forked processes of them need."""

import os
import threading

from tqdm import tqdm

if hasattr(os, "register_at_fork"):
    # Forks share the lock of progress bars with their parent, and one that is killed while it has it keeps it for ever.
    os.register_at_fork(after_in_child=lambda: tqdm.set_lock(threading.RLock()))
