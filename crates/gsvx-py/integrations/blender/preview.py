"""A preview: an ellipsoid for each Gaussian, with the colour of SH degree 0, fading to its rim."""

import bpy

NAME = "gsvx preview"
#: Radius of an ellipsoid in standard deviations.
RADIUS = 2.5
#: More ellipsoids than these make the viewport slow: they are shown in renders only.
VIEWPORT_LIMIT = 300_000
_SH0 = 0.28209479177387814


def add_preview(item):
    """Adds the modifier that draws ellipsoids. Returns whether the viewport shows them."""
    modifier = item.modifiers.new(NAME, "NODES")
    modifier.node_group = bpy.data.node_groups.get(NAME) or _ellipsoids()
    modifier.show_viewport = len(item.data.vertices) <= VIEWPORT_LIMIT
    item.data.materials.append(_material())
    return modifier.show_viewport


class _Nodes:
    """A tree of nodes that is built as an expression."""

    def __init__(self, tree):
        self.tree = tree
        tree.nodes.clear()

    def add(self, kind, *inputs, **settings):
        """A node. Inputs are in the node's order: a socket, a value, or None for the default."""
        node = self.tree.nodes.new(kind)
        for name, value in settings.items():
            setattr(node, name, value)
        for socket, value in zip(node.inputs, inputs):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            elif value is not None:
                socket.default_value = value
        return node

    def math(self, operation, *inputs):
        return self.add("ShaderNodeMath", *inputs, operation=operation).outputs[0]


def _ellipsoids():
    tree = bpy.data.node_groups.new(NAME, "GeometryNodeTree")
    tree.is_modifier = True
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    nodes = _Nodes(tree)

    def attribute(name):
        return nodes.add("GeometryNodeInputNamedAttribute", name, data_type="FLOAT").outputs["Attribute"]

    scales = [nodes.math("EXPONENT", attribute(f"scale_{i}")) for i in range(3)]
    radii = [nodes.math("MULTIPLY", scale, RADIUS) for scale in scales]
    size = nodes.add("ShaderNodeCombineXYZ", *radii).outputs[0]
    turn = nodes.add("FunctionNodeQuaternionToRotation", *[attribute(f"rot_{i}") for i in range(4)])
    ball = nodes.add("GeometryNodeMeshIcoSphere", 1.0, 2).outputs["Mesh"]
    shaded = nodes.add("GeometryNodeSetMaterial", ball, None, _material()).outputs[0]
    points = nodes.add("NodeGroupInput").outputs[0]
    instances = nodes.add("GeometryNodeInstanceOnPoints", points)
    for name, socket in (("Instance", shaded), ("Rotation", turn.outputs[0]), ("Scale", size)):
        tree.links.new(socket, instances.inputs[name])
    nodes.add("NodeGroupOutput", instances.outputs[0])
    return tree


def _material():
    if NAME in bpy.data.materials:
        return bpy.data.materials[NAME]
    material = bpy.data.materials.new(NAME)
    material.use_nodes = True
    nodes = _Nodes(material.node_tree)
    glow = nodes.add("ShaderNodeEmission", _colour(nodes)).outputs[0]
    clear = nodes.add("ShaderNodeBsdfTransparent").outputs[0]
    surface = nodes.add("ShaderNodeMixShader", _alpha(nodes), clear, glow).outputs[0]
    nodes.add("ShaderNodeOutputMaterial", surface)
    return material


def _attribute(nodes, name):
    return nodes.add("ShaderNodeAttribute", attribute_type="INSTANCER", attribute_name=name).outputs["Fac"]


def _colour(nodes):
    """Colours are trained for screens; Blender renders linear light."""
    channels = [nodes.math("MULTIPLY_ADD", _attribute(nodes, f"f_dc_{i}"), _SH0, 0.5) for i in range(3)]
    light = [nodes.math("POWER", nodes.math("MAXIMUM", channel, 0.0), 2.2) for channel in channels]
    return nodes.add("ShaderNodeCombineColor", *light).outputs[0]


def _alpha(nodes):
    """Opacity times the most that the Gaussian has along the ray, on the side that faces the camera."""
    odds = nodes.math("EXPONENT", nodes.math("MULTIPLY", _attribute(nodes, "opacity"), -1.0))
    opacity = nodes.math("DIVIDE", 1.0, nodes.math("ADD", odds, 1.0))
    # In the space of the instance the ellipsoid is a unit sphere.
    geometry = nodes.add("ShaderNodeNewGeometry").outputs
    place = nodes.add("ShaderNodeTexCoord").outputs["Object"]
    local = {"vector_type": "VECTOR", "convert_from": "WORLD", "convert_to": "OBJECT"}
    ray = nodes.add("ShaderNodeVectorTransform", geometry["Incoming"], **local).outputs[0]
    ray = nodes.add("ShaderNodeVectorMath", ray, operation="NORMALIZE").outputs["Vector"]
    along = _dot(nodes, place, ray)
    squared = nodes.math("SUBTRACT", _dot(nodes, place, place), nodes.math("MULTIPLY", along, along))
    falloff = nodes.math("EXPONENT", nodes.math("MULTIPLY", squared, -RADIUS * RADIUS / 2))
    front = nodes.math("SUBTRACT", 1.0, geometry["Backfacing"])
    return nodes.math("MULTIPLY", nodes.math("MULTIPLY", opacity, falloff), front)


def _dot(nodes, a, b):
    return nodes.add("ShaderNodeVectorMath", a, b, operation="DOT_PRODUCT").outputs["Value"]
