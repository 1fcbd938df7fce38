"""What MAPIE makes of errors in error bars: pip install mapie; python scripts/make_conformal_goldens.py

A model that always says 0 has the errors as residuals, so half of the width of MAPIE's split conformal interval is the
quantile that Farsight's fits take (farsight-core, statistics).
"""

import numpy as np
from mapie.regression import SplitConformalRegressor
from sklearn.dummy import DummyRegressor

SHARES = [0.5, 0.6827, 0.9]


def errors(count: int) -> np.ndarray:
    """Different for each k, with a long tail, of both signs."""
    part = np.modf(0.618_033_988_75 * np.arange(1, count + 1))[0]
    return np.log1p(-part) * np.where(np.arange(count) % 2 == 0, 1.0, -1.0)


def half_widths(count: int) -> list[float]:
    inputs = np.zeros((count, 1))
    model = DummyRegressor(strategy="constant", constant=0.0).fit(inputs, errors(count))
    regressor = SplitConformalRegressor(model, confidence_level=SHARES, prefit=True)
    regressor.conformalize(inputs, errors(count))
    _, intervals = regressor.predict_interval(inputs[:1])
    return intervals[0, 1, :].tolist()


if __name__ == "__main__":
    for count in [10, 19, 50, 99, 100, 333]:
        print(f"({count}, [{', '.join(f'{width:.9f}' for width in half_widths(count))}]),")
