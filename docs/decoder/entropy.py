"""Bytes, plain bits, and the entropy coder: format.md, sections 1 and 4; format-lossless.md, section 1."""
import struct


class Refused(ValueError):
    """The stream, or a part of it, is not valid."""


def need(condition, why):
    if not condition:
        raise Refused(why)


def clamp(value, least, greatest):
    return min(max(value, least), greatest)


def crc32c(data, crc=0xFFFFFFFF):
    for byte in data:
        crc = CRC_TABLE[(crc ^ byte) & 255] ^ (crc >> 8)
    return crc ^ 0xFFFFFFFF


def crc_entry(value):
    for _ in range(8):
        value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
    return value


CRC_TABLE = [crc_entry(value) for value in range(256)]


class Bytes:
    """Reads fields from a run of bytes."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, length):
        need(length <= len(self.data) - self.at, "a field goes beyond the end")
        self.at += length
        return self.data[self.at - length:self.at]

    def rest(self):
        return self.take(len(self.data) - self.at)

    def numbers(self, types):
        return struct.unpack("<" + types, self.take(struct.calcsize("<" + types)))

    def number(self, type_):
        return self.numbers(type_)[0]

    def varint(self):
        value = 0
        for shift in range(0, 70, 7):
            byte = self.number("B")
            value |= (byte & 127) << shift
            if byte < 128:
                need(value < 2**64, "a varint is 2^64 or more")
                return value
        raise Refused("a varint has more than ten bytes")

    def zigzag(self):
        return unfold(self.varint())

    def sized(self):
        return self.take(self.varint())


def unfold(value):
    """0, 1, 2, 3, 4 stand for 0, -1, 1, -2, 2."""
    return -(value + 1) // 2 if value & 1 else value // 2


class Decision:
    """The adaptive probability of one kind of decision (4.2)."""
    __slots__ = ("p", "n")

    def __init__(self):
        self.p, self.n = 2**21, 0

    def learn(self, outcome, limit):
        target = 2**22 - 1 if outcome else 0
        self.p += ((target - self.p) * (131072 // (2 * self.n + 3))) >> 16
        if self.n < limit:
            self.n += 1


class Symbols:
    """The adaptive frequencies of the symbols 0 to 15, started as geometric(v, w) (4.3)."""

    def __init__(self, v, w):
        q = clamp(65536 * v // (v + 256), 300, 65000)
        left = 32 * w * 2**16
        self.counts = []
        for _ in range(16):
            beyond = (left * q) >> 16
            self.counts.append(((left - beyond) >> 16) + 1)
            left = beyond
        self.wait = self.period = 4
        self.make_intervals()

    def make_intervals(self):
        scale = 32752 * 2**32 // sum(self.counts)
        self.starts, below = [], 0
        for symbol, count in enumerate(self.counts):
            self.starts.append(symbol + ((below * scale) >> 32))
            below += count
        self.starts.append(2**15)

    def learn(self, symbol):
        self.counts[symbol] += 32
        self.wait -= 1
        if self.wait == 0:
            if sum(self.counts) >= 2**15:
                self.counts = [(count + 1) // 2 for count in self.counts]
            self.wait = self.period = min(2 * self.period, 64)
            self.make_intervals()


class Models(dict):
    """A table of models, each made from its key when it is first used."""

    def __init__(self, make=lambda key: Decision()):
        super().__init__()
        self.make = make

    def __missing__(self, key):
        self[key] = model = self.make(key)
        return model


class Block:
    """An entropy block (4.1)."""

    def __init__(self, data):
        self.words, self.states, self.plain = (), [2**16] * 4, b""
        self.lane = self.next_word = self.next_bit = 0
        if data:
            data = Bytes(data)
            count = data.varint()
            self.states = list(data.numbers("4I"))
            need(min(self.states) >= 2**16, "a state of an entropy block is below 2^16")
            self.words = struct.unpack("<%dH" % count, data.take(2 * count))
            self.plain = data.rest()

    def end(self):
        need(self.next_word == len(self.words), "an entropy block has words left")
        need(self.states == [2**16] * 4, "a state of an entropy block does not end at 2^16")

    def code(self):
        return self.states[self.lane] & 32767

    def advance(self, start, size):
        x = self.states[self.lane]
        x = size * (x >> 15) + (x & 32767) - start
        if x < 2**16:
            need(self.next_word < len(self.words), "an entropy block needs a word beyond its end")
            x = (x << 16) + self.words[self.next_word]
            self.next_word += 1
        self.states[self.lane] = x
        self.lane = (self.lane + 1) & 3

    def decision_of(self, probability):
        outcome = self.code() < probability
        self.advance(*((0, probability) if outcome else (probability, 2**15 - probability)))
        return outcome

    def decision(self, model, limit):
        outcome = self.decision_of(clamp(model.p >> 7, 16, 2**15 - 16))
        model.learn(outcome, limit)
        return outcome

    def symbol(self, model):
        code, symbol = self.code(), 0
        while code >= model.starts[symbol + 1]:
            symbol += 1
        self.advance(model.starts[symbol], model.starts[symbol + 1] - model.starts[symbol])
        model.learn(symbol)
        return symbol

    def bits(self, count):
        value = 0
        for at in range(self.next_bit, self.next_bit + count):
            need(at < 8 * len(self.plain), "an entropy block needs a plain bit beyond its end")
            value = 2 * value + (self.plain[at >> 3] >> (7 - (at & 7)) & 1)
        self.next_bit += count
        return value

    def gamma(self):
        zeros = 0
        while zeros < 32 and self.bits(1) == 0:
            zeros += 1
        return min(2**zeros + self.bits(zeros) - 1, 2**32 - 1)

    def signed_gamma(self):
        return unfold(self.gamma())

    def mixed_decision(self, weights, models, limit):
        """`weights` are those of the mixer, and learn (format-lossless.md, section 1)."""
        inputs = [STRETCH[clamp(model.p >> 10, 2, 4094)] for model in models]
        p = squash(sum(weight * x for weight, x in zip(weights, inputs)) >> 16)
        outcome = self.decision_of(p >> 1)
        error = 3 * (65536 * outcome - p)
        for k, x in enumerate(inputs):
            weight = weights[k] + ((x * error + 2**17) >> 18)
            weights[k] = (weight + 2**31) % 2**32 - 2**31
        for model in models:
            model.learn(outcome, limit)
        return outcome

    def tree(self, models, place, bits, limit):
        """A number of `bits` bits; the models are models[place, node]."""
        node = 1
        for _ in range(bits):
            node = 2 * node + self.decision(models[place, node], limit)
        return node - 2**bits

    def below_leading_one(self, models, bits):
        """A number of `bits` bits, at least 1, whose second to fourth bits are modelled."""
        modelled = min(bits - 1, 3)
        head = 2**modelled + self.tree(models, bits, modelled, 255)
        return (head << (bits - 1 - modelled)) + self.bits(bits - 1 - modelled)


def squash_table():
    table, e = [], 2**40
    for _ in range(2048):
        table.append(min((65536 * e + (2**40 + e) // 2) // (2**40 + e), 65504))
        e = (e * 4629735647166717428) >> 62
    return [65536 - value for value in table[:0:-1]] + table


def stretch_table():
    table, x = [0, 0], -2047
    for q in range(2, 4095):
        while x < 2047 and squash(x) < 16 * q + 8:
            x += 1
        table.append(x)
    return table


def squash(x):
    return SQUASH[clamp(x, -2047, 2047) + 2047]


SQUASH = squash_table()
STRETCH = stretch_table()
