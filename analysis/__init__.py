"""Analysis of condition-monitoring series. All methods get arrays and return results as arrays."""

from .causes import Cause, Days, Effects, Form, Judgement
from .cross_correlation import (
    cross_correlation_lags,
    isolate_axis_by_lags,
    leading_axis,
)
from .detection import CUSUMChart, EWMAChart
from .divergence import HistogramDivergence, kl_divergence
from .effect_posterior import EffectPosterior
from .friction_features import FrictionFeatures
from .isolation import Answer, ChangeIsolator
from .pca import PCAMonitor, held_out_q_limit
from .remaining_life import Forecast, forecast_severity, phm_score
from .run_length import (
    RunLength,
    cusum_interval,
    cusum_run_length,
    ewma_run_length,
    ewma_width,
)
from .symbols import quantile_symbols
from .te_bins import choose_bins, isolation_by_bins
from .transfer_entropy import (
    effective_net_transfer_entropy,
    effective_transfer_entropy,
    isolate_axis,
    net_transfer_entropy,
    transfer_entropy,
    transfer_entropy_matrix,
)

__all__ = [
    "Answer",
    "CUSUMChart",
    "Cause",
    "ChangeIsolator",
    "Days",
    "EWMAChart",
    "EffectPosterior",
    "Effects",
    "Forecast",
    "Form",
    "FrictionFeatures",
    "HistogramDivergence",
    "Judgement",
    "PCAMonitor",
    "RunLength",
    "choose_bins",
    "cross_correlation_lags",
    "cusum_interval",
    "cusum_run_length",
    "effective_net_transfer_entropy",
    "effective_transfer_entropy",
    "ewma_run_length",
    "ewma_width",
    "forecast_severity",
    "held_out_q_limit",
    "isolate_axis",
    "isolate_axis_by_lags",
    "isolation_by_bins",
    "kl_divergence",
    "leading_axis",
    "net_transfer_entropy",
    "phm_score",
    "quantile_symbols",
    "transfer_entropy",
    "transfer_entropy_matrix",
]
