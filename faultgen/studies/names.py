"""The studies that there are. Their names are known without importing what they need."""

STUDIES = {
    "events": "chapter 2: event logs of a fleet before failures, PCA with T2 and Q",
    "classifiers": "chapter 5: does preprocessing help to foresee gearbox failures, on a fleet",
    "detection": "chapter 3: from which hour on wear is detected and located, PUMA 560",
    "detectability": "which severity of every effect can be seen, on which axis and in which task",
    "isolation": "chapter 6: which axis is worn, by transfer entropy, cross-correlation and ours",
    "training-data": "chapter 4: which robot's data, and which signal, PCA learns from, on a fleet",
}
"""Name and content of every study."""
