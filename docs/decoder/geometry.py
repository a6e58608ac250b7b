"""The leaves of a chunk: format.md, section 6."""
from itertools import product

from entropy import clamp, floor_log2, need

CHILDREN = list(product((0, 1), repeat=3))  # child number 4x + 2y + z
OFFSETS = [e for e in product((-1, 0, 1), repeat=3) if any(e)]

def densities(amount, component):
    """floor(amount / |v|^4) for each child c, where component(k, c) is v_k."""
    return [amount // sum(component(k, c) ** 2 for k in range(3)) ** 2 for c in CHILDREN]

LATER, SINGLE = ({e: densities(amount, lambda k, c: 4 * e[k] + 1 - 2 * c[k]) for e in OFFSETS}
                 for amount in (131072, 65536))
SPLIT = {(e, q): densities(4096, lambda k, c: 2 * e[k] + CHILDREN[q][k] - c[k])
         for e in OFFSETS for q in range(8)}

def axes(code, depth):
    """The x, y and z index in a Morton code, or in an array of them."""
    return [sum(((code >> (3 * i + 2 - k) & 1) << i for i in range(depth)), 0 * code) for k in range(3)]

class Node:
    """A cell with leaves in it. `children` is None until known, and empty if the node is single."""

    def __init__(self, code, place, siblings):
        self.code, self.place, self.siblings, self.children = code, place, siblings, None

    def child(self, number):
        place = [2 * i + bit for i, bit in zip(self.place, CHILDREN[number])]
        return Node(8 * self.code + number, tuple(place), len(self.children))

    def look_around(self, cells):
        """6.1. `cells` has the nodes of this depth by their places."""
        x, y, z = self.place
        found = ((e, cells.get((x + e[0], y + e[1], z + e[2]))) for e in OFFSETS)
        self.neighbours = [(e, other) for e, other in found if other]
        self.around = len(self.neighbours)
        self.faces = sum(sum(map(abs, e)) == 1 for e, _ in self.neighbours)
        self.lean = [sum(e[k] for e, _ in self.neighbours) for k in range(3)]

    def shares_and_total(self):
        """The contexts of 6.3: share of each child, total."""
        density = [0] * 8
        for e, other in self.neighbours:
            parts = [LATER[e]] if other.children is None else [SPLIT[e, q] for q in other.children] or [SINGLE[e]]
            density = [sum(terms) for terms in zip(density, *parts)]
        if not any(density):
            return [0] * 8, 0
        level = log16(sum(density))
        shares = [1 + clamp((3 * (log16(d) - level + 96)) >> 4, 0, 18) for d in density]
        return shares, 1 + min(3 * max(level - 128, 0) // 32, 14)

def log16(v):
    """L(v) of 6.3."""
    l = floor_log2(v)
    return 16 * l + ((16 * v) >> l) - 16

class Geometry:
    def __init__(self, block, J, mixed, planes):
        self.block, self.J, self.mixed, self.planes = block, J, mixed, planes
        self.slabs = {}  # 6.4: the two counts of a slab by depth, axis, index

    def leaves(self, count):
        """The leaves as pairs of Morton code and depth, in Morton order."""
        leaves, nodes = [], [Node(0, (0, 0, 0), 1)]
        for d in range(self.J):
            cells, next_nodes, self.last_depths = {node.place: node for node in nodes}, [], (d, d)
            for node in nodes:
                node.look_around(cells)
                single = "single", min(node.around, 15), node.faces, node.siblings
                if (d == 0 or node.siblings > 1) and self.block.decision(single, 255):
                    leaves.append(self.leaf(node, d))
                    node.children = []
                else:
                    node.children = self.children(node, d)
                    next_nodes += [node.child(c) for c in node.children]
                need(len(leaves) + len(next_nodes) <= count, "a chunk has too many leaves")
            nodes = next_nodes
        leaves += [(node.code, self.J) for node in nodes]
        need(len(leaves) == count, "a chunk has too few leaves")
        return sorted(leaves)

    def leaf(self, node, d):
        """6.2, and 6.4 for the path."""
        block, code, depth = self.block, node.code, self.J
        if self.mixed:
            i = min(sum(self.last_depths) - 2 * d, 31)
            h = block.symbol(("below", i, min(node.around, 3)), 64 * i, 2)
            depth = min(d + h + (block.gamma() if h == 15 else 0), self.J)
            self.last_depths = self.last_depths[1], depth
        place = list(node.place)
        for e in range(d, depth):
            for k, lean in enumerate(node.lean):
                if self.planes:
                    counts = self.slab(e, k, place[k])
                    bit = block.decision(("slab", *counts), 255)
                    learn(counts, {int(bit)})
                elif e > d or abs(lean) < 2:
                    bit = block.bits(1)
                else:
                    bit = block.decision(("half", abs(lean), node.around), 255) == (lean > 0)
                place[k], code = 2 * place[k] + bit, 2 * code + bit
        return code << 3 * (self.J - depth), depth

    def slab(self, depth, k, index):
        return self.slabs.setdefault((depth, k, index % 4096), [0, 0])

    def children(self, node, d):
        """6.3."""
        (shares, total), found = node.shares_and_total(), []
        least = 2 if d + 1 == self.J else 1
        slabs = [self.slab(d, k, node.place[k]) for k in range(3)] if self.planes else []
        for c, halves in enumerate(CHILDREN):
            fit = sum((n[half] == 0 < n[1 - half]) + 4 * (n[1 - half] == 0 < n[half])
                      for n, half in zip(slabs, halves))
            occupied = "occupied", shares[c], total, min(len(found), 3), fit
            if 8 - c == least - len(found) or self.block.decision(occupied, 255):
                found.append(c)
        for k, counts in enumerate(slabs):
            learn(counts, {CHILDREN[c][k] for c in found})
        return found

def learn(counts, halves):
    """6.4: the halves in `halves` are occupied."""
    for half in 0, 1:
        counts[half] = min(counts[half] + 1, 7) if half in halves else counts[half] - counts[half] // 2
