"""Fixtures of pytest that check derivatives: ``assert_jacobian``, ``assert_gradient``, ``assert_hessian`` and ``assert_adjoint``.

pytest loads this module by itself. Each fixture is a function with the arguments of :func:`sprung.check_jacobian` and its siblings; it returns
the report, or fails the test with its text. Neither numpy nor sprung is imported before a fixture is called.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


def _asserting(name: str) -> Callable[..., Any]:
    def check(*arguments: Any, **options: Any) -> Any:
        __tracebackhide__ = True
        import sprung

        report = getattr(sprung, name)(*arguments, **options)
        if not report:
            pytest.fail(str(report))
        return report

    return check


@pytest.fixture(scope="session")
def assert_jacobian() -> Callable[..., Any]:
    """:func:`sprung.check_jacobian` as an assertion."""
    return _asserting("check_jacobian")


@pytest.fixture(scope="session")
def assert_gradient() -> Callable[..., Any]:
    """:func:`sprung.check_gradient` as an assertion."""
    return _asserting("check_gradient")


@pytest.fixture(scope="session")
def assert_hessian() -> Callable[..., Any]:
    """:func:`sprung.check_hessian` as an assertion."""
    return _asserting("check_hessian")


@pytest.fixture(scope="session")
def assert_adjoint() -> Callable[..., Any]:
    """:func:`sprung.check_adjoint` as an assertion."""
    return _asserting("check_adjoint")
