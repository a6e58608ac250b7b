"""Bytes, plain bits and the entropy coder: format.md, sections 1 and 4."""
import io
import struct
from collections import defaultdict

from trace import note_symbol

def need(condition, why):
    """Refuses the stream unless the condition holds."""
    if not condition:
        raise ValueError(why)

def clamp(value, least, greatest):
    return min(max(value, least), greatest)

def floor_log2(value):
    return value.bit_length() - 1

def unfold(value):
    """0, 1, 2, 3, 4 stand for 0, -1, 1, -2, 2."""
    return -(value + 1) // 2 if value & 1 else value // 2

CRC_TABLE = range(256)
for _ in range(8):
    CRC_TABLE = [value >> 1 ^ (value & 1) * 0x82F63B78 for value in CRC_TABLE]

def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc = CRC_TABLE[(crc ^ byte) & 255] ^ crc >> 8
    return crc ^ 0xFFFFFFFF

class Bytes(io.BytesIO):
    """Reads fields from a run of bytes."""

    def take(self, length):
        data = self.read(length)
        need(len(data) == length, "a field goes beyond the end")
        return data

    def numbers(self, types):
        """Numbers by the letters that the module `struct` has for their types."""
        return struct.unpack("<" + types, self.take(struct.calcsize("<" + types)))

    def number(self, type_):
        return self.numbers(type_)[0]

    def varint(self):
        value, shift, byte = 0, 0, 128
        while byte >= 128:
            byte = self.number("B")
            value |= (byte & 127) << shift
            shift += 7
        need(shift <= 70 and value < 2**64, "a varint is too long")
        return value

    def zigzag(self):
        return unfold(self.varint())

    def sized(self):
        return self.take(self.varint())

def learn(model, outcome, limit):
    """What a decision model, a list of p and n, learns (4.2)."""
    p, n = model
    target = 2**22 - 1 if outcome else 0
    model[:] = p + (((target - p) * (131072 // (2 * n + 3))) >> 16), min(n + 1, limit)

class Symbols:
    """A symbol model, started as geometric(v, w) (4.3)."""

    def __init__(self, v, w):
        q, left = clamp(65536 * v // (v + 256), 300, 65000), 32 * w * 2**16
        self.counts = []
        for _ in range(16):
            beyond = (left * q) >> 16
            self.counts.append(((left - beyond) >> 16) + 1)
            left = beyond
        self.wait = self.period = 4
        self.make_intervals()

    def make_intervals(self):
        scale = 32752 * 2**32 // sum(self.counts)
        self.bounds = [s + ((sum(self.counts[:s]) * scale) >> 32) for s in range(16)] + [2**15]

    def learn(self, symbol):
        self.counts[symbol] += 32
        self.wait -= 1
        if self.wait == 0:
            if sum(self.counts) >= 2**15:
                self.counts = [(count + 1) // 2 for count in self.counts]
            self.wait = self.period = min(2 * self.period, 64)
            self.make_intervals()

class Block:
    """An entropy block (4.1) with its models, which are made when they are first used.

    The key of a model is its name in the document, then its indices.
    """

    def __init__(self, data):
        self.words, self.states, self.plain = [], [2**16] * 4, ""
        self.lane = self.next_word = self.next_bit = 0
        if data:
            data = Bytes(data)
            count = data.varint()
            self.states = list(data.numbers("4I"))
            need(min(self.states) >= 2**16, "a state of an entropy block is below 2^16")
            self.words = data.numbers(f"{count}H")
            self.plain = "".join(f"{byte:08b}" for byte in data.read())
        self.start_models()

    def start_models(self):
        self.decisions, self.symbols = defaultdict(lambda: [2**21, 0]), {}

    def end(self):
        need(self.next_word == len(self.words), "an entropy block has words left")
        need(self.states == [2**16] * 4, "a state of an entropy block does not end at 2^16")

    def interval(self, bounds):
        """Decodes a symbol: the number of its interval, which lies between two of the bounds."""
        x, symbol = self.states[self.lane], 0
        before = x
        while x % 2**15 >= bounds[symbol + 1]:
            symbol += 1
        x = (bounds[symbol + 1] - bounds[symbol]) * (x >> 15) + x % 2**15 - bounds[symbol]
        if x < 2**16:
            need(self.next_word < len(self.words), "an entropy block needs a word beyond its end")
            x = x * 2**16 + self.words[self.next_word]
            self.next_word += 1
        note_symbol(self.lane, before, bounds[symbol], bounds[symbol + 1] - bounds[symbol], x)
        self.states[self.lane] = x
        self.lane = (self.lane + 1) % 4
        return symbol

    def decision_of(self, p):
        return 1 - self.interval((0, p, 2**15))

    def decision(self, key, limit):
        model = self.decisions[key]
        outcome = self.decision_of(clamp(model[0] >> 7, 16, 2**15 - 16))
        learn(model, outcome, limit)
        return outcome

    def symbol(self, key, v, w):
        """A symbol whose model starts as geometric(v, w)."""
        model = self.symbols.get(key) or self.symbols.setdefault(key, Symbols(v, w))
        symbol = self.interval(model.bounds)
        model.learn(symbol)
        return symbol

    def bits(self, count):
        digits = self.plain[self.next_bit:self.next_bit + count]
        need(len(digits) == count, "an entropy block needs a plain bit beyond its end")
        self.next_bit += count
        return int(digits or "0", 2)

    def gamma(self):
        zeros = 0
        while zeros < 32 and self.bits(1) == 0:
            zeros += 1
        return min(2**zeros + self.bits(zeros) - 1, 2**32 - 1)
