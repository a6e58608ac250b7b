"""Decodes forged streams, each behind its length on standard input, with the Python package."""

import json
import resource
import struct
import sys

import gsvx

number, accepted, failed = 0, 0, []
while length := sys.stdin.buffer.read(4):
    data = sys.stdin.buffer.read(struct.unpack("<I", length)[0])
    for salvage in (False, True):
        try:
            gsvx.decompress_bytes(data, salvage=salvage)
            accepted += not salvage
        except gsvx.Error:
            pass
        except BaseException as error:  # A panic is no Exception.
            failed.append(number)
            print(f"{number}: {error!r}", file=sys.stderr)
    number += 1
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
print(json.dumps({"streams": number, "accepted": accepted, "failed": failed, "peak": peak}))
