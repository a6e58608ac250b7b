"""The leaves of a chunk: format.md, section 6."""
from itertools import product

from entropy import need

CHILDREN = list(product((0, 1), repeat=3))  # child number 4x + 2y + z
OFFSETS = [e for e in product((-1, 0, 1), repeat=3) if any(e)]
# For each child, the offsets of the seven cells around its node that touch it.
TOUCHING = [[e for e in OFFSETS if all(step in (0, 2 * half - 1) for step, half in zip(e, c))] for c in CHILDREN]

def axes(code, depth):
    """The x, y and z index in a Morton code, or in an array of them."""
    return [sum(((code >> (3 * i + 2 - k) & 1) << i for i in range(depth)), 0 * code) for k in range(3)]

class Node:
    """A cell with leaves in it."""

    def __init__(self, code, place, only_child):
        self.code, self.place, self.only_child = code, place, only_child

    def child(self, number, only_child):
        place = [2 * i + half for i, half in zip(self.place, CHILDREN[number])]
        return Node(8 * self.code + number, tuple(place), only_child)

    def neighbours(self, places, offsets):
        """How many of the cells at these offsets are in `places`, the places of all nodes of this depth."""
        return sum(tuple(i + step for i, step in zip(self.place, e)) in places for e in offsets)

def leaves(block, J, count):
    """The leaves as pairs of Morton code and depth, in Morton order."""
    found, nodes = [], [Node(0, (0, 0, 0), False)]
    for d in range(J):
        places, next_nodes = {node.place for node in nodes}, []
        for node in nodes:
            single = "single", node.neighbours(places, OFFSETS)
            if not node.only_child and block.decision(single, 255):
                found.append(leaf(block, node, d, J))
            else:
                children = children_of(block, node, places, 2 if d + 1 == J else 1)
                next_nodes += [node.child(c, len(children) == 1) for c in children]
            need(len(found) + len(next_nodes) <= count, "a chunk has too many leaves")
        nodes = next_nodes
    found += [(node.code, J) for node in nodes]
    need(len(found) == count, "a chunk has too few leaves")
    return sorted(found)

def leaf(block, node, d, J):
    """6.2."""
    below = block.symbol(("below", d), 512, 2)
    below = min(below + (block.gamma() if below == 15 else 0), J - d)
    code = node.code << 3 * below | block.bits(3 * below)
    return code << 3 * (J - d - below), d + below

def children_of(block, node, places, least):
    """6.3."""
    found = []
    for c, halves in enumerate(CHILDREN):
        touching = node.neighbours(places, TOUCHING[c])
        beside = sum(bin(c ^ other).count("1") == 1 for other in found)
        occupied = "occupied", touching, c, beside, min(len(found), 3)
        if 8 - c == least - len(found) or block.decision(occupied, 255):
            found.append(c)
    return found
