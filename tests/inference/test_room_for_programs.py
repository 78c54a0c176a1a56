"""Compiled programs are forgotten before a process has no memory mappings left."""

import jax
import jax.numpy as jnp
import pytest

import bayesmotion as bm
from bayesmotion import programs
from bayesmotion.inference import methods
from bayesmotion.programs import forget_programs


@pytest.fixture
def compiled():
    """A function that counts how often it is traced, called once."""
    traced = []

    @jax.jit
    def double(x):
        traced.append(x)
        return 2 * x

    double(jnp.zeros(2))
    return lambda: (double(jnp.zeros(2)), len(traced))[1]


def test_programs_are_kept_while_there_is_room(compiled, tmp_path, monkeypatch):
    maps = tmp_path / "maps"
    maps.write_bytes(b"a mapping\n" * 3)
    monkeypatch.setattr(programs, "_MAPS", maps)
    assert not forget_programs(most=3)
    assert compiled() == 1
    assert forget_programs(most=2)
    assert compiled() == 2


def test_nothing_is_forgotten_where_mappings_are_not_told(compiled, tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "_MAPS", tmp_path / "none")
    assert not forget_programs(most=0)
    assert compiled() == 1


@pytest.mark.filterwarnings("ignore:the fit stopped")
def test_a_fit_begins_with_room_for_its_programs(line, line_motion, monkeypatch):
    called = []
    monkeypatch.setattr(methods, "forget_programs", lambda: called.append(True))
    bm.fit(line, line_motion, method=bm.MAP(initial=1, keep=1, max_steps=5))
    assert called == [True]
