"""The leaves of a chunk: format.md, section 6."""
from itertools import product

from entropy import Models, Symbols, clamp, need

CHILDREN = list(product((0, 1), repeat=3))  # child number 4x + 2y + z
OFFSETS = [e for e in product((-1, 0, 1), repeat=3) if any(e)]


def densities(amount, vector):
    """floor(amount / |v|^4) for all eight children, `vector(k, c)` being component k of v."""
    return [amount // sum(vector(k, c) ** 2 for k in range(3)) ** 2 for c in CHILDREN]


LATER, SINGLE = ({e: densities(amount, lambda k, c: 4 * e[k] + 1 - 2 * c[k]) for e in OFFSETS}
                 for amount in (131072, 65536))
SPLIT = {(e, q): densities(4096, lambda k, c: 2 * e[k] + CHILDREN[q][k] - c[k])
         for e in OFFSETS for q in range(8)}


class Node:
    """A cell of some depth with leaves in it. `children` is None until known, and () if it is single."""

    def __init__(self, code, place, siblings):
        self.code, self.place, self.siblings = code, place, siblings
        self.children = None

    def child(self, number, siblings):
        place = tuple(2 * i + bit for i, bit in zip(self.place, CHILDREN[number]))
        return Node(8 * self.code + number, place, siblings)


class Surroundings:
    """The neighbours of a node (6.1)."""

    def __init__(self, node, cells):
        x, y, z = node.place
        found = ((e, cells.get((x + e[0], y + e[1], z + e[2]))) for e in OFFSETS)
        self.neighbours = [(e, other) for e, other in found if other]
        self.around = len(self.neighbours)
        self.faces = sum(sum(map(abs, e)) == 1 for e, _ in self.neighbours)
        self.lean = [sum(e[k] for e, _ in self.neighbours) for k in range(3)]


def log16(v):
    """L(v) of 6.3."""
    l = v.bit_length() - 1
    return 16 * l + ((16 * v) >> l) - 16


def occupancy_contexts(neighbours):
    """`share` of each child, and `total` (6.3)."""
    density = [0] * 8
    for e, other in neighbours:
        if other.children is None:
            parts = [LATER[e]]
        elif other.children == ():
            parts = [SINGLE[e]]
        else:
            parts = [SPLIT[e, q] for q in other.children]
        for part in parts:
            density = [a + b for a, b in zip(density, part)]
    total = sum(density)
    if total == 0:
        return [0] * 8, 0
    level = log16(total)
    shares = [1 + clamp((3 * (log16(d) - level + 96)) >> 4, 0, 18) for d in density]
    return shares, 1 + min(3 * max(level - 128, 0) // 32, 14)


class Geometry:
    def __init__(self, block, greatest_depth, mixed):
        self.block, self.greatest_depth, self.mixed = block, greatest_depth, mixed
        self.single, self.half, self.occupied = Models(), Models(), Models()
        self.below = Models(lambda key: Symbols(64 * key[0], 2))

    def decode(self, count):
        """The leaves as pairs of Morton code and depth, in Morton order."""
        J, leaves, nodes = self.greatest_depth, [], [Node(0, (0, 0, 0), 1)]
        for d in range(J):
            cells = {node.place: node for node in nodes}
            next_nodes, self.last_depths = [], (d, d)
            for node in nodes:
                view = Surroundings(node, cells)
                if self.is_single(node, view, d):
                    leaves.append(self.leaf(node, view, d))
                    node.children = ()
                else:
                    node.children = self.children(view, 2 if d + 1 == J else 1)
                    next_nodes += [node.child(c, len(node.children)) for c in node.children]
                need(len(leaves) + len(next_nodes) <= count, "a chunk has too many leaves")
            nodes = next_nodes
        leaves += [(node.code, J) for node in nodes]
        need(len(leaves) == count, "a chunk has another number of leaves than its index says")
        return sorted(leaves)

    def is_single(self, node, view, d):
        if d > 0 and node.siblings == 1:
            return False
        return self.block.decision(self.single[min(view.around, 15), view.faces, node.siblings], 255)

    def leaf(self, node, view, d):
        h = self.leaf_depth(view, d) - d
        code = node.code
        if h > 0:
            for lean in view.lean:
                code = 2 * code + self.half_bit(lean, view.around)
            code = (code << 3 * (h - 1)) + self.block.bits(3 * (h - 1))
        return code << 3 * (self.greatest_depth - d - h), d + h

    def leaf_depth(self, view, d):
        if not self.mixed:
            return self.greatest_depth
        h = self.block.symbol(self.below[min(sum(self.last_depths) - 2 * d, 31), min(view.around, 3)])
        if h == 15:
            h += self.block.gamma()
        depth = min(d + h, self.greatest_depth)
        self.last_depths = (self.last_depths[1], depth)
        return depth

    def half_bit(self, lean, around):
        if abs(lean) < 2:
            return self.block.bits(1)
        return self.block.decision(self.half[abs(lean), around], 255) == (lean > 0)

    def children(self, view, least):
        shares, total = occupancy_contexts(view.neighbours)
        found = []
        for c in range(8):
            if 8 - c == least - len(found) or self.block.decision(
                    self.occupied[shares[c], total, min(len(found), 3)], 255):
                found.append(c)
        return found


def decode_leaves(block, greatest_depth, mixed, count):
    return Geometry(block, greatest_depth, mixed).decode(count)
