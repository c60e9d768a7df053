"""Elementary functions whose derivatives are right where JAX's own are not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.physics.derivatives import compress, direction, root, scaled_expm1

X = jnp.array([-2.0, -0.3, 1e-3, 0.5, 4.0])


@pytest.mark.parametrize(("function", "plain", "at_zero"), [
    (root, jnp.sqrt, 0.0),
    (lambda x: scaled_expm1(0.3, x), lambda x: 0.3 * (jnp.exp(jnp.abs(x)) - 1) * jnp.sign(x), 0.3),
    (compress, lambda x: jnp.sign(x) * jnp.log1p(5 * jnp.abs(x)), 5.0),
    (lambda y: direction(y, 0.7 * y), lambda y: jnp.arctan2(y, 0.7 * y), 0.0),
    (lambda x: direction(jnp.full_like(x, 0.7), x), lambda x: jnp.arctan2(0.7, x), -1 / 0.7),
])  # fmt: skip
def test_values_are_the_plain_ones_and_slopes_too_but_at_zero(function, plain, at_zero):
    x = jnp.abs(X) if plain is jnp.sqrt else X
    np.testing.assert_array_equal(function(x), plain(x))
    slopes = jax.vmap(jax.grad(function))(x), jax.vmap(jax.grad(plain))(x)
    np.testing.assert_allclose(*slopes, rtol=1e-5, atol=1e-6)
    assert jax.grad(function)(jnp.zeros(())) == pytest.approx(at_zero)


def test_the_scale_has_a_slope_too():
    assert jax.grad(scaled_expm1)(2.0, jnp.float32(-0.5)) == pytest.approx(1 - np.exp(0.5))
