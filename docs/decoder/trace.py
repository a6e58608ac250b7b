"""What a decoder of the golden stream default.gsvx should see on its way: fixtures/streams/default.trace.

    python3 trace.py       prints it: the first wrong line of another decoder is where it goes wrong
"""
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "fixtures" / "streams"
SYMBOLS, ROWS = 20, 4

lines = None  # those of the trace, while one is made
symbols = 0

def note(text):
    if lines is not None:
        lines.append(text)

def note_symbol(lane, before, start, size, after):
    """A symbol of an entropy block, decisions included: its state before, its interval, its state after."""
    global symbols
    if lines is not None and symbols < SYMBOLS:
        note(f"symbol {symbols}: x_{lane} = {before:#010x}, interval {start} .. {start + size}, then {after:#010x}")
        symbols += 1

def note_rows(what, rows):
    for i, row in enumerate(rows[:ROWS]):
        note(f"  {what} {i}: {' '.join(map(str, row.tolist()))}")

def trace(stream):
    from gsvx_decoder import decode
    global lines, symbols
    lines, symbols = [], 0
    scene = decode(stream)
    for name, values in scene._asdict().items():
        note(name)
        note_rows("Gaussian", values.reshape(len(values), -1))
    made, lines = lines, None
    return "\n".join(made) + "\n"

if __name__ == "__main__":
    import trace as module  # the one that the decoder writes to
    print(module.trace((FOLDER / "default.gsvx").read_bytes()), end="")
