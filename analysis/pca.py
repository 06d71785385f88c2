"""Monitoring by principal components: Hotelling's T2 along the components, Q for the residual.

    monitor = PCAMonitor(n_components=0.75).fit(healthy)  # shape (samples, variables)
    monitor.predict(new)  # +1 normal, -1 not
    monitor.t2(new), monitor.q(new), monitor.limits(0.99)  # two charts and their limits
    monitor.q_contributions(new)  # which variables cause it, shape (samples, variables)

All results have one row for each row of the data, in the same order. They do not depend on random
numbers.
"""

from __future__ import annotations

from numbers import Integral, Real
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from sklearn.base import BaseEstimator, OutlierMixin, TransformerMixin, clone
from sklearn.utils.validation import check_is_fitted, validate_data

Floats = NDArray[np.float64]
T2Limit = Literal["new", "training", "chi2", "pls_toolbox"]

_CONSTANT = 1e-12  # relative to its values; a column that moves less does not move
_ROUNDING = 1e-18  # relative squared length; what is shorter is rounding
_T2_LIMITS = ("new", "training", "chi2", "pls_toolbox")


class PCAMonitor(OutlierMixin, TransformerMixin, BaseEstimator):
    """Detector of samples that do not follow the correlations of healthy ones.

    A row is autoscaled to z, its scores are t = P z, and then

        T2 = sum_k t_k^2 / lambda_k,  Q = ||z - P' t||^2,  ||z||^2 = ||t||^2 + Q

    T2 is the distance of a row from the mean along the components that are kept. Q is its distance
    from these components. `t2_limit_` and `q_limit_` are the limits of the two charts: each alone
    accepts the share `confidence` of healthy rows. A row is not normal if either statistic is above
    its limit in `joint_limits_`. These limits are higher, so that both together accept the share
    `confidence`: T2 and Q of Gaussian rows are independent, hence each gets the confidence
    sqrt(`confidence`) (Sidak). To judge rows by the two charts alone, as the thesis does, compare
    `t2` and `q` with `limits`.

    A column that is constant in the healthy data has no scale. It is not scaled, it is not part of
    any component, and its deviation, in its own unit squared, is added to Q. If no column varies,
    there is no component: T2 is 0 and has no limit. If healthy rows have no residual at all, the
    limit of Q is 0, and any Q above rounding is not normal. This happens with as many components as
    variables.

    The limits assume Gaussian rows and exactly known components. With few samples the components
    are not known exactly: after a fit to 120 Gaussian samples of 6 columns without correlation, 11
    % of new rows are above the 95 % limit of Q. If there are enough healthy rows, set thresholds on
    rows that were not used in the fit.

    With lags, each row is extended by its predecessors (dynamic PCA), so that X must be one series
    in order of time. All results still have one row for each row of X. The first `lags` rows have
    too few predecessors: they are nan, and `predict` accepts them. Neighbouring rows then share
    values, which the limits do not take into account.

    Source: thesis 3.2.2; Jackson and Mudholkar (1979), Control procedures for residuals associated
    with principal component analysis; Tracy, Young and Mason (1992), Multivariate control charts
    for individual observations; Ku, Storer and Georgakis (1995), Disturbance detection and
    isolation by dynamic principal component analysis.

    Args:
        n_components: Number of components, or the share of variance within (0, 1) that they must
            exceed.
        scale: Whether columns are divided by their standard deviation. If not, all columns must
            have one unit.
        confidence: Share of healthy rows that `predict` calls normal, and also the share below
            `t2_limit_` and the share below `q_limit_`, within (0, 1).
        t2_limit: Distribution of T2, for a components and n samples: "new" for rows that were not
            fitted, a (n^2 - 1) / (n (n - a)) F; "training" for rows that were fitted,
            (n - 1)^2 / n Beta; "chi2" for many samples; "pls_toolbox" for the values of that
            program and of mdatools, a (n - 1) / (n - a) F.
        lags: Number of predecessors of each row.

    Attributes:
        mean_: Mean of each column and, with lags, of its predecessors: first those one row before,
            then two rows before. Shape (columns,), where columns = variables * (1 + lags).
        scale_: Standard deviation (divisor n - 1) of the same, 1 if constant. Shape (columns,).
        components_: Rows are unit vectors. Shape (n_components_, columns).
        eigenvalues_: Variance along all components, descending. Shape (columns,).
        n_components_: Number of components that are kept.
        n_samples_: Number of rows that were fitted: those of X minus `lags`.
        n_features_in_: Number of variables.
        t2_limit_: Limit of T2 alone at `confidence`.
        q_limit_: Limit of Q alone at `confidence`, by Jackson and Mudholkar.
        joint_limits_: Limits of T2 and Q that `predict` uses.
        offset_: -1, the lowest score of a normal row.
    """

    def __init__(
        self,
        *,
        n_components: int | float = 0.75,
        scale: bool = True,
        confidence: float = 0.95,
        t2_limit: T2Limit = "new",
        lags: int = 0,
    ) -> None:
        self.n_components = n_components
        self.scale = scale
        self.confidence = confidence
        self.t2_limit = t2_limit
        self.lags = lags

    def fit(self, X: ArrayLike, y: object = None) -> Self:
        """Learn components and limits from healthy rows.

        Args:
            X: Healthy rows. Shape (samples, variables), in any units.
            y: Not used.

        Returns:
            The monitor itself.

        Raises:
            ValueError: If X is not finite or has too few rows, or if an
                argument of the constructor is invalid.
        """
        self._check_arguments()
        checked: Floats = validate_data(self, X, dtype=np.float64, ensure_min_samples=self.lags + 3)
        rows = self._augmented(checked)
        n, columns = rows.shape
        constant = np.ptp(rows, axis=0) <= _CONSTANT * np.abs(rows).max(axis=0)
        self.mean_ = np.where(constant, rows[0], rows.mean(axis=0))
        centred = rows - self.mean_
        self.scale_ = np.ones(columns)
        if self.scale:
            self.scale_[~constant] = np.std(centred, axis=0, ddof=1)[~constant]
        _, singular, directions = np.linalg.svd(centred / self.scale_, full_matrices=False)
        self.eigenvalues_ = np.zeros(columns)
        self.eigenvalues_[: len(singular)] = singular**2 / (n - 1)
        self.eigenvalues_[self.eigenvalues_ <= _ROUNDING * self.eigenvalues_[0]] = 0.0
        self.n_samples_ = n
        self.n_components_ = self._count_components()
        # A component and its opposite are one; the largest loading is made positive.
        kept = directions[: self.n_components_]
        largest = np.abs(kept).argmax(axis=1)
        self.components_ = kept * np.sign(kept[np.arange(len(kept)), largest])[:, None]
        self.t2_limit_, self.q_limit_ = self.limits(self.confidence)
        two_charts = 0 < self.n_components_ < np.count_nonzero(self.eigenvalues_)
        self.joint_limits_ = self.limits(self.confidence ** (0.5 if two_charts else 1.0))
        self.offset_ = -1.0
        return self

    def transform(self, X: ArrayLike) -> Floats:
        """Compute the scores t of rows along the components.

        Args:
            X: Rows. Shape (samples, variables), in the units of the fit.

        Returns:
            Scores. Shape (samples, n_components_).

        Raises:
            ValueError: If X is not finite or has other columns than the fit. All other methods
                raise it for the same reasons.
        """
        return self._scaled(X) @ self.components_.T

    def t2(self, X: ArrayLike) -> Floats:
        """Compute Hotelling's T2 of rows.

        Args:
            X: Rows. Shape (samples, variables), in the units of the fit.

        Returns:
            T2, without unit. Shape (samples,).
        """
        return np.sum(self.transform(X) ** 2 / self._variances(), axis=1)

    def q(self, X: ArrayLike) -> Floats:
        """Compute Q of rows, the squared prediction error, see `transform`.

        Values within rounding errors are set to 0, so that a limit of 0 can be used.

        Args:
            X: Rows. Shape (samples, variables), in the units of the fit.

        Returns:
            Q, without unit if columns are scaled. Shape (samples,).
        """
        return self._q(self._scaled(X))

    def t2_contributions(self, X: ArrayLike) -> Floats:
        """Decompose T2 completely into z_j (P' Lambda^-1 P z)_j of each variable j.

        The contributions of a row sum to its T2; single ones can be negative. Those of a variable's
        predecessors are added to the variable.

        Source: Alcala and Qin (2011), Analysis and generalization of fault diagnosis methods for
        process monitoring.

        Args:
            X: Rows. Shape (samples, variables), in the units of the fit.

        Returns:
            Contributions. Shape (samples, variables).
        """
        z = self._scaled(X)
        weighted = (z @ self.components_.T / self._variances()) @ self.components_
        return self._by_variable(z * weighted)

    def q_contributions(self, X: ArrayLike) -> Floats:
        """Compute the squared residual of each variable. Those of a row sum to its Q.

        Those of a variable's predecessors are added to the variable.

        Args:
            X: Rows. Shape (samples, variables), in the units of the fit.

        Returns:
            Contributions, at least 0. Shape (samples, variables).
        """
        return self._by_variable(self._residuals(self._scaled(X)) ** 2)

    def limits(self, confidence: float) -> tuple[float, float]:
        """Compute the limits of T2 alone and of Q alone at another confidence.

        Args:
            confidence: Share of healthy rows below each limit, within (0, 1).

        Returns:
            Limit of T2 and limit of Q.

        Raises:
            ValueError: If confidence is not within (0, 1).
        """
        check_is_fitted(self, "components_")
        _check_confidence(confidence)
        a, n = self.n_components_, self.n_samples_
        if a == 0:
            return np.inf, 0.0
        if self.t2_limit == "training":
            t2 = (n - 1) ** 2 / n * stats.beta.ppf(confidence, a / 2, (n - a - 1) / 2)
        elif self.t2_limit == "chi2":
            t2 = stats.chi2.ppf(confidence, a)
        else:
            t2 = a * (n - 1) / (n - a) * stats.f.ppf(confidence, a, n - a)
            if self.t2_limit == "new":
                t2 *= (n + 1) / n
        return float(t2), _jackson_mudholkar(self.eigenvalues_[a:], confidence)

    def score_samples(self, X: ArrayLike) -> Floats:
        """Compute minus the larger of T2 and Q, each divided by its joint limit.

        Args:
            X: Rows. Shape (samples, variables), in the units of the fit.

        Returns:
            Scores: higher is more normal, below -1 is not normal. Shape (samples,).
        """
        z = self._scaled(X)
        t2 = np.sum((z @ self.components_.T) ** 2 / self._variances(), axis=1)
        rounding = _ROUNDING * (1 + np.sum(z**2, axis=1))
        t2_limit, q_limit = self.joint_limits_
        return -np.maximum(t2 / t2_limit, self._q(z) / np.maximum(q_limit, rounding))

    def decision_function(self, X: ArrayLike) -> Floats:
        """Compute `score_samples` minus `offset_`.

        Args:
            X: Rows. Shape (samples, variables), in the units of the fit.

        Returns:
            Negative values for rows that are not normal. Shape (samples,).
        """
        return self.score_samples(X) - self.offset_

    def predict(self, X: ArrayLike) -> NDArray[np.int_]:
        """Mark normal rows with +1 and others with -1. The first `lags` rows are +1.

        Args:
            X: Rows. Shape (samples, variables), in the units of the fit.

        Returns:
            +1 or -1. Shape (samples,).
        """
        return np.where(self.decision_function(X) < 0, -1, 1)

    def _check_arguments(self) -> None:
        share = self.n_components
        if isinstance(share, Integral):
            valid = share >= 1 and not isinstance(share, bool)
        else:
            valid = isinstance(share, Real) and 0 < share < 1
        if not valid:
            raise ValueError(
                f"n_components must be a whole number from 1, or a share within (0, 1), got {share}"
            )
        _check_confidence(self.confidence)
        if self.t2_limit not in _T2_LIMITS:
            raise ValueError(f"t2_limit must be one of {_T2_LIMITS}, got {self.t2_limit!r}")
        if not isinstance(self.lags, Integral) or self.lags < 0:
            raise ValueError(f"lags must be a whole number from 0, got {self.lags}")

    def _count_components(self) -> int:
        rank = int(np.sum(self.eigenvalues_ > 0))
        if isinstance(self.n_components, Integral):
            kept = int(self.n_components)
            if kept > rank:
                raise ValueError(
                    f"n_components is {kept}, but {self.n_samples_} samples of "
                    f"{len(self.eigenvalues_)} columns vary in {rank} directions only"
                )
        elif rank == 0:
            kept = 0
        else:
            explained = np.cumsum(self.eigenvalues_[:rank])
            share = explained / explained[-1]
            kept = int(np.searchsorted(share, self.n_components, side="right")) + 1
        if self.t2_limit == "training" and self.n_samples_ < kept + 2:
            raise ValueError(
                f"t2_limit 'training' with {kept} components needs at least {kept + 2} samples, "
                f"got {self.n_samples_}"
            )
        return kept

    def _augmented(self, X: Floats) -> Floats:
        """Rows extended by their predecessors. Shape (samples - lags, columns)."""
        n = len(X) - self.lags
        return np.hstack([X[self.lags - k : self.lags - k + n] for k in range(self.lags + 1)])

    def _scaled(self, X: ArrayLike) -> Floats:
        """Rows as z, the first `lags` of them nan. Shape (samples, columns)."""
        check_is_fitted(self, "components_")
        checked: Floats = validate_data(self, X, dtype=np.float64, reset=False)
        z = np.full((len(checked), len(self.mean_)), np.nan)
        if len(checked) > self.lags:
            z[self.lags :] = (self._augmented(checked) - self.mean_) / self.scale_
        return z

    def _q(self, z: Floats) -> Floats:
        q = np.sum(self._residuals(z) ** 2, axis=1)
        return np.where(q <= _ROUNDING * (1 + np.sum(z**2, axis=1)), 0.0, q)

    def _residuals(self, z: Floats) -> Floats:
        return z - z @ self.components_.T @ self.components_

    def _variances(self) -> Floats:
        return self.eigenvalues_[: self.n_components_]

    def _by_variable(self, contributions: Floats) -> Floats:
        return contributions.reshape(len(contributions), self.lags + 1, -1).sum(axis=1)


def held_out_q_limit(monitor: PCAMonitor, X: ArrayLike, *, blocks: int = 8) -> float:
    """Compute a limit of Q from healthy rows that were not fitted: blocks are held out in turn.

    The limit is a quantile of Q over all held-out blocks. Jackson and Mudholkar's limit assumes
    that the components are known. If there are hardly more rows than columns, the components fit
    the rows from which they were learned far better than any others, and about half of all healthy
    rows are above that limit.

    Args:
        monitor: Its parameters, including `confidence`, are used. It need not be fitted.
        X: Healthy rows in their order. Shape (samples, variables).
        blocks: Number of blocks of successive rows.

    Returns:
        Limit of Q.

    Raises:
        ValueError: There are fewer than two blocks, or fewer rows than blocks.
    """
    rows = np.asarray(X, dtype=float)
    if not 2 <= blocks <= len(rows):
        raise ValueError(f"blocks must be within 2 and the {len(rows)} rows, got {blocks}")
    q = np.empty(len(rows))
    for block in np.array_split(np.arange(len(rows)), blocks):
        q[block] = clone(monitor).fit(np.delete(rows, block, axis=0)).q(rows[block])
    return float(np.quantile(q, monitor.confidence))


def _check_confidence(confidence: float) -> None:
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be within (0, 1), got {confidence}")


def _jackson_mudholkar(residual: Floats, confidence: float) -> float:
    """Limit of Q from the variances along the components that are not kept."""
    theta1, theta2, theta3 = (float(np.sum(residual**k)) for k in (1, 2, 3))
    if theta1 == 0:
        return 0.0
    # At h0 = 0 the law turns logarithmic; mdatools stops at the same small value.
    h0 = max(1 - 2 * theta1 * theta3 / (3 * theta2**2), 1e-3)
    spread = stats.norm.ppf(confidence) * np.sqrt(2 * theta2) * h0 / theta1
    root = 1 + spread + theta2 * h0 * (h0 - 1) / theta1**2
    return theta1 * float(max(root, 0.0) ** (1 / h0))
