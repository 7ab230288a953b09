"""Holds the main thread of the process with the given number, while its other threads go on. It goes on too when this program
ends. Prints "held"."""

import ctypes
import os
import sys
import time

SEIZE, INTERRUPT = 0x4206, 0x4207  # of ptrace, in linux/ptrace.h

libc = ctypes.CDLL(None, use_errno=True)
for request in (SEIZE, INTERRUPT):
    if libc.ptrace(request, int(sys.argv[1]), None, None) < 0:
        sys.exit(f"ptrace: {os.strerror(ctypes.get_errno())}")
print("held")
time.sleep(600)
