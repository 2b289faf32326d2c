"""Evaluates the metallic-roughness BRDF of glTF 2.0 (appendix B): GGX, height-correlated Smith masking, Schlick's
Fresnel term.

One departure: the diffuse term has what the specular lobe leaves of a uniform sky at this view, 1 - (0.04 a + b) of
`ggx.directional_albedo`, in place of 1 - F(v . h), with which a white surface would give back 1.9 times what it gets at
grazing angles. As in glTF, light that bounces among the microfacets is lost: 1 % at roughness 0.3, 64 % at 0.95.

Unit vectors throughout: n normal, v towards the viewer, l towards the light, h halfway between; alpha = roughness^2.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

PI = wp.constant(wp.pi)
INVERSE_PI = wp.constant(1.0 / wp.pi)

DIELECTRIC = wp.constant(0.04)
"""Reflectance at normal incidence of what is no metal (glTF 2.0)."""

LEAST_BULK = wp.constant(1.0e-30)
"""Keeps v = -l, which has no h, from dividing by 0."""

LEAST_COSINE = wp.constant(1.0e-4)
"""Cosine towards the viewer below which it is held: interpolated normals can turn away from him."""


@wp.func
def normal_reflectance(albedo: wp.vec3, metallic: float):
    """Computes the reflectance at normal incidence, F0 of glTF 2.0."""
    return DIELECTRIC * (1.0 - metallic) * wp.vec3(1.0, 1.0, 1.0) + metallic * albedo


@wp.func
def specular_share(r: wp.vec2, f0: wp.vec3):
    """Computes the part of a uniform sky's light that the specular lobe reflects; r: (a, b) of
    `ggx.directional_albedo` at this view."""
    return r[0] * f0 + r[1] * wp.vec3(1.0, 1.0, 1.0)


@wp.func
def diffuse_share(r: wp.vec2, metallic: float):
    """Computes the part of the light that the specular lobe leaves to the diffuse term, which metals do not have."""
    return (1.0 - metallic) * (1.0 - DIELECTRIC * r[0] - r[1])


@wp.func
def fresnel_weight(cosine: float):
    """Gives the share of Schlick's reflectance that does not depend on f0."""
    m = wp.clamp(1.0 - cosine, 0.0, 1.0)
    return m * m * m * m * m


@wp.func
def fresnel(f0: wp.vec3, cosine: float):
    """Gives Schlick's reflectance at cosine = v . h."""
    return f0 + fresnel_weight(cosine) * (wp.vec3(1.0, 1.0, 1.0) - f0)


@wp.func
def distribution(alpha: float, n: wp.vec3, h: wp.vec3):
    """Gives GGX density of microfacet normals along h, of any length but 0.

    sin^2 is taken from n x h, for 1 - cos^2 has no digits in a narrow lobe.
    """
    cosine = wp.dot(n, h)
    sine = wp.cross(n, h)
    bulk = cosine * cosine * alpha * alpha + wp.dot(sine, sine)
    ratio = alpha * wp.dot(h, h) / wp.max(bulk, LEAST_BULK)
    return ratio * ratio * INVERSE_PI


@wp.func
def masking(alpha: float, nl: float, nv: float):
    """Gives height-correlated Smith G2 / (4 n.l n.v) (Heitz, JCGT 3(2), 2014)."""
    a = alpha * alpha
    return 0.5 / (nl * wp.sqrt(nv * nv * (1.0 - a) + a) + nv * wp.sqrt(nl * nl * (1.0 - a) + a))


@wp.func
def view_masking(alpha: float, nv: float):
    """Gives Smith G1 of the viewer."""
    a = alpha * alpha
    return 2.0 * nv / (nv + wp.sqrt(a + (1.0 - a) * nv * nv))


@wp.func
def specular(alpha: float, f0: wp.vec3, n: wp.vec3, v: wp.vec3, l: wp.vec3):
    """Gives the specular BRDF [1/sr] for n.l > 0."""
    h = v + l
    # v . h of the unit vector is half the length of this one.
    f = fresnel(f0, 0.5 * wp.length(h))
    nv = wp.max(wp.dot(n, v), LEAST_COSINE)
    return distribution(alpha, n, h) * masking(alpha, wp.dot(n, l), nv) * f


@wp.func
def sample_density(alpha: float, n: wp.vec3, v: wp.vec3, l: wp.vec3):
    """Gives the density [1/sr] with which `sample_direction` gives l."""
    nv = wp.max(wp.dot(n, v), LEAST_COSINE)
    return distribution(alpha, n, v + l) * view_masking(alpha, nv) / (4.0 * nv)


@wp.func
def lobe_axes(n: wp.vec3, v: wp.vec3):
    """Gives unit vectors t and b across n, t on the viewer's side; any where he looks along n."""
    across = v - wp.dot(n, v) * n
    if wp.dot(across, across) < 1.0e-10:
        across = wp.cross(n, wp.vec3(0.0, 1.0, 0.0))
        if wp.abs(n[1]) > 0.7:
            across = wp.cross(n, wp.vec3(1.0, 0.0, 0.0))
    t = wp.normalize(across)
    return t, wp.cross(n, t)


@wp.func
def stretched_view(alpha: float, nv: float):
    """Gives the direction of the viewer, by t, b and n, once microfacets are stretched to a hemisphere."""
    return wp.normalize(wp.vec3(alpha * wp.sqrt(1.0 - nv * nv), 0.0, nv))


@wp.func
def sample_cap(stretched: wp.vec3, turn: wp.vec2, height: float):
    """Gives a normal of the stretched microfacets, of any length, that the viewer sees (Dupuy and Benyoub, HPG 2023).

    turn: cosine and sine of an angle, and height in (0, 1], both uniform over the samples.
    """
    z = height * (1.0 + stretched[2]) - stretched[2]
    r = wp.sqrt(wp.max(1.0 - z * z, 0.0))
    return wp.vec3(r * turn[0], r * turn[1], z) + stretched


@wp.func
def sample_direction(alpha: float, n: wp.vec3, v: wp.vec3, u: wp.vec2):
    """Gives a direction l for u in [0, 1)^2, from the visible normals; n.l may be < 0."""
    nv = wp.clamp(wp.dot(n, v), LEAST_COSINE, 1.0)
    t, b = lobe_axes(n, v)
    phi = 2.0 * PI * u[0]
    cap = sample_cap(stretched_view(alpha, nv), wp.vec2(wp.cos(phi), wp.sin(phi)), 1.0 - u[1])
    h = wp.normalize((alpha * cap[0]) * t + (alpha * cap[1]) * b + wp.max(cap[2], 0.0) * n)
    return wp.normalize(2.0 * wp.dot(v, h) * h - v)
