"""Analysis of condition-monitoring series. All methods get arrays and return results as arrays."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

# at once: the module would hide the function of its name
from .transfer_entropy import (
    effective_net_transfer_entropy,
    effective_transfer_entropy,
    isolate_axis,
    net_transfer_entropy,
    transfer_entropy,
    transfer_entropy_matrix,
)

if TYPE_CHECKING:
    from .causes import Cause, Days, Effects, Form, Judgement
    from .cross_correlation import (
        cross_correlation_lags,
        isolate_axis_by_lags,
        leading_axis,
    )
    from .detection import CUSUMChart, EWMAChart
    from .divergence import HistogramDivergence, kl_divergence
    from .effect_posterior import EffectPosterior
    from .fitted_posterior import FittedPosterior
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

__all__ = [
    "Answer",
    "CUSUMChart",
    "Cause",
    "ChangeIsolator",
    "Days",
    "EWMAChart",
    "EffectPosterior",
    "Effects",
    "FittedPosterior",
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

# scikit-learn and SciPy take a second to import, which a user of one module need not wait for
_HOMES = {
    "Answer": "isolation",
    "Cause": "causes",
    "ChangeIsolator": "isolation",
    "choose_bins": "te_bins",
    "cross_correlation_lags": "cross_correlation",
    "cusum_interval": "run_length",
    "cusum_run_length": "run_length",
    "CUSUMChart": "detection",
    "Days": "causes",
    "EffectPosterior": "effect_posterior",
    "Effects": "causes",
    "ewma_run_length": "run_length",
    "ewma_width": "run_length",
    "EWMAChart": "detection",
    "FittedPosterior": "fitted_posterior",
    "Forecast": "remaining_life",
    "forecast_severity": "remaining_life",
    "Form": "causes",
    "FrictionFeatures": "friction_features",
    "held_out_q_limit": "pca",
    "HistogramDivergence": "divergence",
    "isolate_axis_by_lags": "cross_correlation",
    "isolation_by_bins": "te_bins",
    "Judgement": "causes",
    "kl_divergence": "divergence",
    "leading_axis": "cross_correlation",
    "PCAMonitor": "pca",
    "phm_score": "remaining_life",
    "quantile_symbols": "symbols",
    "RunLength": "run_length",
}


def __getattr__(name: str) -> Any:
    """Import a name of this package when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return __all__
