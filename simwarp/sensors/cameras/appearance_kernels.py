"""Colours of surfaces: image textures, checkers and noise, and colours of mesh corners. All in linear light."""

from enum import IntEnum

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


class TextureKind(IntEnum):
    """Kind of a texture."""

    IMAGE = 0
    CHECKER = 1
    NOISE = 2


IMAGE = wp.constant(int(TextureKind.IMAGE))
CHECKER = wp.constant(int(TextureKind.CHECKER))
SHARP = wp.constant(0.02)  # of a checker's cell: pixels smaller than this see one colour
OCTAVES = wp.constant(4)
LATTICE_X = wp.constant(wp.uint32(0x8DA6B343))  # odd numbers: hashes of lattice points
LATTICE_Y = wp.constant(wp.uint32(0xD8163841))
LATTICE_MIX1 = wp.constant(wp.uint32(0x2C1B3C6D))
LATTICE_MIX2 = wp.constant(wp.uint32(0x297A2D39))


@wp.struct
class AppearanceArrays:
    """Textures and the visuals of meshes, shared by all worlds."""

    texture_kind: wp.array[int]  # TextureKind
    texture_start: wp.array[int]  # of an image's texels
    texture_pixels: wp.array[wp.vec2i]  # width, height of an image
    texture_metres: wp.array[wp.vec2]  # that one repeat covers, along x and y of the instance; 0: by the mesh's UVs
    texture_color0: wp.array[wp.vec3]  # of checker and noise
    texture_color1: wp.array[wp.vec3]
    texel: wp.array[wp.uint32]  # sRGB, 8 bits each: red lowest
    decode: wp.array[float]  # (256,) linear light of an sRGB byte

    tree_visual: wp.array[int]  # first triangle, in the arrays below, of a mesh by the number of its tree; -1: no look
    corner_uv: wp.array[wp.vec2]  # [3 triangle + corner]
    corner_color: wp.array[wp.vec3]
    triangle_texture: wp.array[int]  # -1: none


@wp.func
def texel_color(index: int, appearance: AppearanceArrays) -> wp.vec3:
    """Linear colour of one texel."""
    packed = appearance.texel[index]
    red = int(packed & wp.uint32(255))
    green = int((packed >> wp.uint32(8)) & wp.uint32(255))
    blue = int((packed >> wp.uint32(16)) & wp.uint32(255))
    return wp.vec3(appearance.decode[red], appearance.decode[green], appearance.decode[blue])


@wp.func
def image_color(texture: int, uv: wp.vec2, appearance: AppearanceArrays) -> wp.vec3:
    """Bilinear sample of an image that repeats; u to the right, v upwards, texel centres at half numbers."""
    width = appearance.texture_pixels[texture][0]
    height = appearance.texture_pixels[texture][1]
    start = appearance.texture_start[texture]
    x = (uv[0] - wp.floor(uv[0])) * float(width) - 0.5
    y = (1.0 - (uv[1] - wp.floor(uv[1]))) * float(height) - 0.5
    column = int(wp.floor(x))
    row = int(wp.floor(y))
    right = x - float(column)
    down = y - float(row)
    column0 = (column + width) % width
    column1 = (column + 1) % width
    row0 = start + ((row + height) % height) * width
    row1 = start + ((row + 1) % height) * width
    upper = (1.0 - right) * texel_color(row0 + column0, appearance) + right * texel_color(row0 + column1, appearance)
    lower = (1.0 - right) * texel_color(row1 + column0, appearance) + right * texel_color(row1 + column1, appearance)
    return (1.0 - down) * upper + down * lower


@wp.func
def checker_ramp(x: float, width: float) -> float:
    """Mean of a square wave of period 2 (1 on even cells, -1 on odd ones) over an interval about x."""
    a = 0.5 * (x - 0.5 * width)
    b = 0.5 * (x + 0.5 * width)
    a = wp.abs(a - wp.floor(a) - 0.5)
    b = wp.abs(b - wp.floor(b) - 0.5)
    return 2.0 * (a - b) / width


@wp.func
def checker_share(x: float, y: float, width: float) -> float:
    """Share of the second colour, 0 to 1, in a square of that width about (x, y); all in cells. The cell at the origin
    towards +x, +y has the first colour.
    """
    if width < SHARP:
        odd = int(wp.floor(x)) + int(wp.floor(y))
        return float(odd & 1)
    return 0.5 - 0.5 * checker_ramp(x, width) * checker_ramp(y, width)


@wp.func
def lattice_value(column: int, row: int) -> float:
    """A number in [0, 1) that looks random, the same for the same place."""
    h = wp.uint32(column) * LATTICE_X + wp.uint32(row) * LATTICE_Y
    h = (h ^ (h >> wp.uint32(15))) * LATTICE_MIX1
    h = (h ^ (h >> wp.uint32(12))) * LATTICE_MIX2
    h = h ^ (h >> wp.uint32(15))
    return float(h >> wp.uint32(8)) * 5.9604644775390625e-08


@wp.func
def noise_share(x: float, y: float, width: float) -> float:
    """Sum of smooth lattice noises, each half as large and half as strong as the one before; those finer than `width`
    are left out. In [0, 1]; x, y, width in cells of the coarsest.
    """
    total = float(0.0)
    strength = float(0.5)
    rest = float(1.0)
    for octave in range(OCTAVES):
        if width > 1.0:
            break
        column = int(wp.floor(x))
        row = int(wp.floor(y))
        s = x - float(column)
        t = y - float(row)
        s = s * s * (3.0 - 2.0 * s)
        t = t * t * (3.0 - 2.0 * t)
        column += 57 * octave
        a = lattice_value(column, row)
        b = lattice_value(column + 1, row)
        c = lattice_value(column, row + 1)
        d = lattice_value(column + 1, row + 1)
        total += strength * ((1.0 - t) * ((1.0 - s) * a + s * b) + t * ((1.0 - s) * c + s * d))
        rest -= strength
        strength *= 0.5
        x *= 2.0
        y *= 2.0
        width *= 2.0
    return total + 0.5 * rest


@wp.func
def texture_color(
    texture: int, uv: wp.vec2, local: wp.vec3, footprint: float, appearance: AppearanceArrays
) -> wp.vec3:  # fmt: skip
    """Linear colour of a texture.

    Args:
        texture: index.
        uv: of the mesh; what an image without metres uses.
        local: place in the instance's own frame [m].
        footprint: width of what the pixel sees there [m].
        appearance: tables.
    """
    kind = appearance.texture_kind[texture]
    metres = appearance.texture_metres[texture]
    if kind == IMAGE:
        if metres[0] > 0.0:
            uv = wp.vec2(local[0] / metres[0], local[1] / metres[1])
        return image_color(texture, uv, appearance)
    x = local[0] / metres[0]
    y = local[1] / metres[1]
    share = float(0.0)
    if kind == CHECKER:
        share = checker_share(x, y, footprint / metres[0])
    else:
        share = noise_share(x, y, footprint / metres[0])
    return (1.0 - share) * appearance.texture_color0[texture] + share * appearance.texture_color1[texture]


@wp.func
def surface_color(
    color: wp.vec3, texture: int, tree: int, triangle: int, bary: wp.vec2, local: wp.vec3, footprint: float,
    appearance: AppearanceArrays,
) -> wp.vec3:  # fmt: skip
    """Linear albedo where a ray hit: the instance's colour times that of its texture or of the mesh.

    Args:
        color: of the instance.
        texture: of the instance; -1: those of the mesh's triangles, if it has a look.
        tree: of the instance's mesh; -1: the instance is no mesh.
        triangle: that was hit.
        bary: weights of its corners 1 and 2.
        local: place in the instance's own frame [m].
        footprint: width of what the pixel sees there [m].
        appearance: tables.
    """
    uv = wp.vec2(0.0, 0.0)
    first = int(-1)
    if tree >= 0:
        first = appearance.tree_visual[tree]
    if first >= 0:
        row = first + triangle
        first = 3 * row
        w1 = bary[0]
        w2 = bary[1]
        w0 = 1.0 - w1 - w2
        corner0 = appearance.corner_color[first]
        corner1 = appearance.corner_color[first + 1]
        corner2 = appearance.corner_color[first + 2]
        color = wp.cw_mul(color, w0 * corner0 + w1 * corner1 + w2 * corner2)
        uv = (
            w0 * appearance.corner_uv[first]
            + w1 * appearance.corner_uv[first + 1]
            + w2 * appearance.corner_uv[first + 2]
        )
        if texture < 0:
            texture = appearance.triangle_texture[row]
    if texture < 0:
        return color
    return wp.cw_mul(color, texture_color(texture, uv, local, footprint, appearance))
