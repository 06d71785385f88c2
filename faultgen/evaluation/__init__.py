"""How detectors and isolators are judged on a dataset."""
