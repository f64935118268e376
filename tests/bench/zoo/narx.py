"""A black box for tables: a nonlinear autoregressive model with inputs on random features, the best of some by free runs.

The next change of the outputs is a linear function of the last samples, the inputs and tanh of random combinations of them,
found by ridge regression. A fifth of the training runs chooses the number of samples, of features and the ridge.
"""
import numpy as np

LAGS, FEATURES, RIDGES = (1, 2, 4, 8), (0, 100, 300), (1e-8, 1e-5, 1e-2)


def windows(y, u, lag):
    """Rows of the last `lag` samples [run][time][column]; inputs also of the present interval."""
    last = [y[:, k : y.shape[1] - lag + k] for k in range(lag)]
    last += [u[:, k : u.shape[1] - lag + k] for k in range(lag)]
    return np.concatenate(last, axis=2)


class Model:
    def __init__(self, y, u, lag, nfeature, ridge, rng):
        x = windows(y, u, lag)
        change = (y[:, lag:] - y[:, lag - 1 : -1]).reshape(-1, y.shape[2])
        x = x.reshape(-1, x.shape[2])
        self.lag = lag
        self.mixture = rng.normal(size=(x.shape[1], nfeature)) / np.sqrt(x.shape[1])
        self.shift = rng.normal(size=nfeature)
        features = self.features(x)
        gram = features.T @ features
        self.weights = np.linalg.solve(gram + ridge * len(x) * np.eye(len(gram)), features.T @ change)

    def features(self, x):
        return np.concatenate([np.ones((len(x), 1)), x, np.tanh(x @ self.mixture + self.shift)], axis=1)

    def free_run(self, y, u, start):
        """Predicts [run][time][column] from the samples before `start`."""
        z = y.copy()
        for t in range(start, y.shape[1]):
            past = np.concatenate([z[:, t - self.lag : t].reshape(len(z), -1), u[:, t - self.lag : t].reshape(len(z), -1)], axis=1)
            z[:, t] = np.clip(z[:, t - 1] + self.features(past) @ self.weights, -30, 30)
        return z


def predict(train, train_inputs, test, test_inputs, start, seed=1):
    """Free runs of the test part from the samples before `start`; arrays [run][time][column]."""
    rng = np.random.default_rng(seed)
    mean, spread = train.mean((0, 1)), train.std((0, 1)) + 1e-300
    umean, uspread = train_inputs.mean((0, 1)), train_inputs.std((0, 1)) + 1e-300
    y, v = (train - mean) / spread, (test - mean) / spread
    u, w = (train_inputs - umean) / uspread, (test_inputs - umean) / uspread
    held = np.arange(len(y)) % 5 == 4
    best = None
    for lag in LAGS:
        for nfeature in FEATURES:
            for ridge in RIDGES:
                model = Model(y[~held], u[~held], lag, nfeature, ridge, rng)
                error = np.median(np.sqrt(np.mean((model.free_run(y[held], u[held], max(start, lag)) - y[held]) ** 2, axis=(1, 2))))
                if best is None or error < best[0]:
                    best = error, model
    return best[1].free_run(v, w, max(start, best[1].lag)) * spread + mean
