"""Analysis of condition-monitoring series: arrays in, results out."""

from analysis.cross_correlation import (
    cross_correlation_lags,
    isolate_axis_by_lags,
    leading_axis,
)
from analysis.divergence import HistogramDivergence, kl_divergence
from analysis.pca import PCAMonitor
from analysis.symbols import quantile_symbols
from analysis.transfer_entropy import (
    effective_net_transfer_entropy,
    effective_transfer_entropy,
    isolate_axis,
    net_transfer_entropy,
    transfer_entropy,
    transfer_entropy_matrix,
)

__all__ = [
    "HistogramDivergence",
    "PCAMonitor",
    "cross_correlation_lags",
    "effective_net_transfer_entropy",
    "effective_transfer_entropy",
    "isolate_axis",
    "isolate_axis_by_lags",
    "kl_divergence",
    "leading_axis",
    "net_transfer_entropy",
    "quantile_symbols",
    "transfer_entropy",
    "transfer_entropy_matrix",
]
