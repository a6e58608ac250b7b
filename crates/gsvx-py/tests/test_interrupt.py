"""Ctrl-C, and the GIL."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time

import pytest
from conftest import MODEL, ROOM

import gsvx

SCRIPTS = {
    "tune": "gsvx.tune('out.gsvx', {model!r}, {room!r}, effort='long', progress=say)",
    "search": "gsvx.compress('out.gsvx', {model!r}, cameras={room!r}, target_psnr=45, progress=say)",
}


@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of Unix")
@pytest.mark.parametrize("what", SCRIPTS)
def test_ctrl_c_ends_the_work_and_nothing_is_written(what, tmp_path):
    call = SCRIPTS[what].format(model=str(MODEL), room=str(ROOM))
    script = f"""
import gsvx, signal
# A shell that starts the tests in the background makes its children ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
def say(progress):
    print(progress.stage, flush=True)
try:
    {call}
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    process = subprocess.Popen(
        [sys.executable, "-c", script], cwd=tmp_path, stdout=subprocess.PIPE, text=True
    )
    process.stdout.readline()
    asked = time.monotonic()
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 0 and said.endswith("interrupted\n")
    assert time.monotonic() - asked < 10
    assert not list(tmp_path.iterdir())


def test_other_threads_run_while_a_stream_is_made(splats):
    count, stop = 0, threading.Event()

    def work():
        nonlocal count
        while not stop.is_set():
            count += 1
            time.sleep(0.001)

    thread = threading.Thread(target=work)
    thread.start()
    for _ in range(5):
        gsvx.compress_to_bytes(splats, lossless=True)
    counted = count
    stop.set()
    thread.join()
    assert counted > 50


@pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="no fork here")
def test_a_process_forks_between_two_calls(small):
    import os

    want = gsvx.compress_to_bytes(small)
    child = os.fork()
    if child == 0:
        same = gsvx.compress_to_bytes(small) == want
        os._exit(0 if same else 1)
    for _ in range(600):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        time.sleep(0.1)
    else:
        os.kill(child, signal.SIGKILL)
        pytest.fail("the child hangs")
    assert os.waitstatus_to_exitcode(status) == 0
