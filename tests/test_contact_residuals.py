"""The seven residuals of a contact problem, one by one, and the projection that they use."""

from __future__ import annotations

import numpy as np
import pytest
from contact_problems import missed_by_a_cone, onto_cone
from hypothesis import given, settings
from hypothesis import strategies as st
from shared import each_row

from condyn_pin.contact import ContactProblem, ContactSets, contact_residuals, natural_residual
from condyn_pin.contact.problem import OPEN, SLIDE, STICK, ContactsInModes

MU = 0.5
NAMES = (
    "cone", "dual", "complementarity", "signorini", "uplift", "dissipation", "natural",
)  # fmt: skip


def one(sigma, lam, law="ncp", mu=MU):
    """Return the residuals of one contact with this impulse and this velocity; |g| = 1."""
    lam, sigma = np.array(lam, float), np.array(sigma, float)
    problem = ContactProblem(np.eye(3), sigma - lam, [mu], law=law)
    vars(problem)["scale"] = (1.0, 1.0)
    return contact_residuals(problem, lam)


def broken(residuals) -> set[str]:
    return {name for name in NAMES if getattr(residuals, name) > 1e-12}


@each_row(
    ("sigma", "lam"),
    [
        ((0.3, 0.1, 0.2), (0.0, 0.0, 0.0)),  # open
        ((0.0, 0.0, 0.0), (0.2, 0.1, 1.0)),  # sticks
        ((-0.4, 0.3, 0.0), (0.4, -0.3, 1.0)),  # slides
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),  # grazes
    ],
)
def test_nothing_is_missed_where_the_law_holds(sigma, lam):
    assert broken(one(sigma, lam)) == set()


@each_row(
    ("sigma", "lam", "missed"),
    [
        # pulls
        ((0, 0, 0), (0, 0, -1), {"cone": 1.0, "natural": 1.0}),
        # pushes sideways more than friction can
        ((0, 0, 0), (1, 0, 1), {"cone": 0.5 / np.hypot(1, MU)}),
        # falls in
        ((0, 0, -0.3), (0, 0, 0), {"dual": 0.3, "signorini": 0.3}),
        # lifts off while it is pushed
        ((0, 0, 0.2), (0, 0, 1), {"complementarity": 0.2, "signorini": 0.2, "uplift": 0.2}),
        # slides without all the friction: half of mu l_n |s_t| is missing
        ((-1, 0, 0), (0.25, 0, 1), {"dissipation": 0.25, "complementarity": 0.25}),
        # slides one way, and is pushed across
        ((-1, 0, 0), (0, 0.5, 1), {"dissipation": 0.5 * np.sqrt(2), "complementarity": 0.5}),
    ],
)
def test_each_residual_is_what_its_condition_misses(sigma, lam, missed):
    residuals = one(sigma, lam)
    for name, size in missed.items():
        assert getattr(residuals, name) == pytest.approx(size), name
    assert broken(residuals) == {*missed, "natural"}


@pytest.mark.parametrize("mu", [MU, 10.0, 1e3])
@pytest.mark.parametrize("pushed", [1.0, 1e-7])
def test_what_sticks_misses_its_slip_and_its_fall(mu, pushed):
    """Not mu times its slip; and no slip hides a fall, where s_n + mu |s_t| is zero."""
    lam = pushed * np.array([0.2, 0.1, 1.0])
    assert one((1e-9, 0, 0), lam, mu=mu).natural == pytest.approx(1e-9)
    lam, fall = np.array([0.2, 0.1, 1.0]), mu * 1e-9
    assert one((1e-9, 0, -fall), lam, mu=mu).natural == pytest.approx(max(fall, 1e-9))


@pytest.mark.long
def test_what_friction_cannot_hold_is_not_judged_as_stuck():
    for mu in (MU, 1e3):
        assert one((0, 0, 0), (1.1 * mu, 0, 1), mu=mu).natural > 0.05 * min(mu, 1 / mu)
        assert one((0, 0, 0), (0, 0, -1), mu=mu).natural == 1.0


@pytest.mark.long
def test_the_convex_law_lifts_what_slides():
    """lam and sigma on the surfaces of K and K*, orthogonal: right in a ccp, not in an ncp."""
    sigma, lam = (-1.0, 0.0, MU), (MU, 0.0, 1.0)
    convex = one(sigma, lam, law="ccp")
    assert broken(convex) == {"signorini", "uplift"}
    assert convex.uplift == pytest.approx(MU)
    assert broken(one(sigma, lam)) == {"complementarity", "signorini", "uplift", "natural"}
    # and the other way round
    assert broken(one((-1, 0, 0), (MU, 0, 1), law="ccp")) == {"dual", "complementarity", "natural"}


@pytest.mark.long
def test_without_friction_only_the_normal_is_asked():
    assert broken(one((1.0, 2.0, 0.0), (0.0, 0.0, 1.0), mu=0.0)) == set()
    assert broken(one((0, 0, 0), (0, 0, -1), mu=0.0)) == {"cone", "natural"}


@each_row(
    ("s", "l", "missed"),
    [
        (0.0, 2.0, set()),
        (1.0, 0.0, set()),
        (0.0, -1.0, {"cone", "natural"}),
        (-1.0, 0.0, {"dual", "signorini", "natural"}),
        (1.0, 1.0, {"complementarity", "signorini", "uplift", "natural"}),
    ],
)
def test_stops(s, l, missed):  # noqa: E741
    problem = ContactProblem([[1.0]], [s - l], [], half_lines=1)
    assert broken(contact_residuals(problem, np.array([l]))) == missed


@each_row(
    ("s", "l", "missed"),
    [
        (0.0, 0.5, set()),
        (0.0, -2.0, set()),
        (1.0, -2.0, set()),
        (-1.0, 2.0, set()),
        (0.0, 3.0, {"cone", "natural"}),
        (1.0, 1.0, {"dissipation", "natural"}),
        (1.0, 2.0, {"dissipation", "natural"}),
    ],
)
def test_dry_friction(s, l, missed):  # noqa: E741
    problem = ContactProblem([[1.0]], [s - l], [], limits=[2.0])
    assert broken(contact_residuals(problem, np.array([l]))) == missed


def test_natural_residual_is_a_number_without_a_unit():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(14, 14))
    G, g, lam = X.T @ X, rng.normal(size=14), rng.normal(size=14)
    first = ContactProblem(G, g, [0.3, 0.7, 1.0], half_lines=3, limits=[0.5, 1.0])
    again = ContactProblem(3e4 * G, 7e-3 * g, [0.3, 0.7, 1.0], 3, first.limits * (7e-3 / 3e4))
    one, two = contact_residuals(first, lam), contact_residuals(again, lam * (7e-3 / 3e4))
    assert two == pytest.approx(one, rel=1e-12)
    assert natural_residual(first, lam) == one.natural


@pytest.mark.long
def test_what_is_not_a_number_is_no_small_residual():
    problem = ContactProblem(np.eye(3), [0, 0, -1.0], [0.5])
    for bad in (np.nan, np.inf):
        with np.errstate(invalid="ignore"):
            assert not natural_residual(problem, np.array([0.0, 0.0, bad])) <= 1e-8


numbers = st.floats(-1e3, 1e3, allow_subnormal=False)
points = st.lists(numbers, min_size=8, max_size=8).map(np.array)
frictions = st.lists(st.sampled_from([0.0, 1e-3, 0.3, 1.0, 10.0]), min_size=2, max_size=2)


def sets(friction) -> ContactSets:
    return ContactSets(np.array(friction), 1, np.array([0.7]))


@given(x=points, friction=frictions)
def test_projection_is_the_nearest_point(x, friction):
    p = sets(friction).project(x)
    size = 1e-12 * max(1.0, np.abs(x).max())
    for i, mu in enumerate(friction):
        rows = slice(3 * i, 3 * i + 3)
        assert p[rows] == pytest.approx(onto_cone(x[rows], mu), abs=size)
    assert p[6] == max(x[6], 0.0)
    assert p[7] == np.clip(x[7], -0.7, 0.7)


@given(x=points, friction=frictions)
def test_projection_splits_by_moreau(x, friction):
    """x = P_K(x) - P_K*(-x), the two orthogonal."""
    cones = ContactSets(np.array(friction), 0, np.zeros(0))
    x = x[:6]
    p = cones.project(x)
    rest = p - x  # in K*: mu |t| <= n
    size = max(1.0, np.abs(x).max())
    assert abs(p @ rest) <= 1e-12 * size**2
    for i, mu in enumerate(friction):
        t1, t2, n = rest[3 * i : 3 * i + 3]
        assert mu * np.hypot(t1, t2) <= n + 1e-11 * size


@pytest.mark.long
@given(x=points, y=points, friction=frictions)
def test_projection_brings_points_no_further_apart(x, y, friction):
    K = sets(friction)
    p, r = K.project(x), K.project(y)
    assert np.linalg.norm(p - r) <= np.linalg.norm(x - y) * (1 + 1e-12) + 1e-12
    assert K.project(p) == pytest.approx(p, rel=1e-12, abs=1e-12)


@settings(deadline=None)
@given(x=points, friction=frictions, seed=st.integers(0, 1000))
def test_slopes_are_those_of_the_projection(x, friction, seed):
    K, h = sets(friction), 1e-6
    dx = np.random.default_rng(seed).normal(size=8)
    P, free = K.slopes(x)
    analytic = np.concatenate([(P @ dx[:6].reshape(2, 3, 1)).ravel(), free * dx[6:]])
    differences = (K.project(x + h * dx) - K.project(x - h * dx)) / (2 * h)
    # a difference across an edge is neither slope
    sides = [K.slopes(x + sign * h * dx) for sign in (-1, 1)]
    if all(np.abs(each[0] - P).max() < 1e-3 and (each[1] == free).all() for each in sides):
        assert analytic == pytest.approx(differences, abs=1e-5)


@pytest.mark.long
@given(lam=points, g=points, friction=frictions, law=st.sampled_from(["ncp", "ccp"]))
def test_the_judge_projects_as_solvers_do(lam, g, friction, law):
    """The natural residual has lines of its own, so that no solver is proved by what it runs."""
    G = np.eye(8) + 0.25  # which feel each other
    problem = ContactProblem(G, g, friction, half_lines=1, limits=[0.7], law=law)
    stiff, speed = problem.scale
    d = problem.dual(problem.velocities(lam))
    sigma = problem.velocities(lam)
    missed = list(np.abs(lam - problem.sets.project(lam - d / stiff))[6:])
    for rows, mu in zip((slice(3), slice(3, 6)), friction, strict=True):
        missed.append(missed_by_a_cone(lam[rows], sigma[rows] / stiff, d[rows] / stiff, mu))
    missed = max(missed) * stiff / speed
    rounding = 1e-14 * (np.abs(lam).max() + np.abs(d).max()) * stiff / speed
    assert natural_residual(problem, lam) == pytest.approx(missed, rel=1e-9, abs=rounding)


@pytest.mark.parametrize("law", ["ncp", "ccp"])
@pytest.mark.parametrize(
    "modes",
    [
        [OPEN, STICK, SLIDE, SLIDE, OPEN, STICK, SLIDE],
        [SLIDE, OPEN, STICK, SLIDE, STICK, SLIDE, STICK],
        [STICK, SLIDE, OPEN, STICK, OPEN, SLIDE, SLIDE],
    ],
)
def test_equations_of_modes_and_their_partials(modes, law):
    """Against the laws of Coulomb, and central differences; the last cone is ice."""
    rng, h = np.random.default_rng(0), 1e-6
    X = rng.normal(size=(15, 15))
    friction, limits = np.array([0.5, 0.8, 0.3, 0.0]), [0.4, 0.2]
    problem = ContactProblem(
        X @ X.T / 15, rng.normal(size=15), friction, half_lines=1, limits=limits, law=law
    )
    lam, modes = rng.normal(size=15), np.array(modes)
    found = ContactsInModes(problem, modes).at(lam)
    sigma = problem.velocities(lam)
    for i, mode in enumerate(modes):
        rows = slice(3 * i, 3 * i + 3) if i < 4 else 8 + i
        left, l, s = found.left[rows], lam[rows], sigma[rows]  # noqa: E741  of the equations
        if mode == OPEN:
            right = l
        elif mode == STICK and i != 3:
            right = s
        elif i < 4:  # of the normals of a ccp, what slides lifts off
            slip = np.hypot(s[0], s[1])
            lift = friction[i] * slip if law == "ccp" else 0.0
            right = [*(l[:2] + friction[i] * l[2] * s[:2] / slip), s[2] - lift]
        else:
            right = l + limits[i - 5] * np.sign(s)
        np.testing.assert_allclose(left, right, rtol=0.0, atol=1e-14)

    def slope(made):
        """Central difference of what is left, where made(+-h) is a problem and impulses."""
        one, two = (ContactsInModes(of, modes).at(at).left for of, at in (made(h), made(-h)))
        return (one - two) / (2 * h)

    for unit, column, force in zip(
        np.eye(15), found.by_sigma.T, (found.by_sigma @ problem.G + found.by_lam).T, strict=True
    ):
        by_g = slope(lambda x, unit=unit: (problem.replaced(g=problem.g + x * unit), lam))
        by_lam = slope(lambda x, unit=unit: (problem, lam + x * unit))
        np.testing.assert_allclose(by_g, column, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(by_lam, force, rtol=0.0, atol=1e-8)
    for unit, column in zip(np.eye(4)[:3], found.by_friction.T, strict=False):
        by_mu = slope(lambda x, unit=unit: (problem.replaced(friction=friction + x * unit), lam))
        np.testing.assert_allclose(by_mu, column, rtol=0.0, atol=1e-8)
