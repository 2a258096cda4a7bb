r"""Stiffness and damping from samples, by recursive least squares with directional forgetting.

.. math:: F = k\,d + b\,v = \phi \cdot \theta, \qquad r = \phi \cdot P \phi, \qquad
          \theta \mathrel{+}= \frac{P \phi}{1 + r} (F - \phi \cdot \theta), \qquad
          P \mathrel{-}= \frac{P \phi \phi^T P}{1 / \beta + r}, \quad
          \beta = \lambda - \frac{1 - \lambda}{r}

Old information is forgotten only in the direction in which there is new one. With plain forgetting
P would grow without bound where nothing comes, such as along b for a hand at one speed.

Source: R. Kulhavy and M. Karny, Tracking of slowly varying parameters by directional forgetting,
IFAC World Congress, 1984.
"""

UNSURE_STIFFNESS, UNSURE_DAMPING = 1e7, 1e4  # N/m, N s/m: of an estimate, over 1 N of noise
UNSURE = (UNSURE_STIFFNESS**2, 0.0, UNSURE_DAMPING**2)
CHANGED = 0.5  # of the force: two samples this far from what was expected: it has changed


class SpringDamper:
    """An estimate of a spring and a damper side by side: k, in N/m, and b, in N s/m.

    ``forgetting`` is the weight of the information before at each new sample, λ, above 0, at most
    1.
    """

    def __init__(self, forgetting: float) -> None:
        self._forgetting = forgetting
        self._covariance = UNSURE  # P: kk, kb, bb
        self._is_doubted = False  # the last sample contradicted it, and was left out
        self.stiffness, self.damping = 0.0, 0.0
        self.samples = 0  # that have been taken in

    def add(self, depth: float, speed: float, force: float) -> None:
        """Take a sample in: ``depth`` in m, ``speed`` in m/s and ``force`` in N, or changes."""
        expected = self.stiffness * depth + self.damping * speed
        is_far = abs(force - expected) > CHANGED * max(abs(force), abs(expected))
        if self.samples > 1 and is_far and not self._is_doubted:
            self._is_doubted = True
            return  # one may be an error
        if self._is_doubted and is_far:
            self._covariance = UNSURE
        self._is_doubted = False
        kk, kb, bb = self._covariance
        k, b = kk * depth + kb * speed, kb * depth + bb * speed
        known = depth * k + speed * b
        if known <= 0.0:  # depth and speed are 0
            return
        error = (force - expected) / (1.0 + known)
        self.stiffness += k * error
        self.damping += b * error
        beta = self._forgetting - (1.0 - self._forgetting) / known
        taken = beta / (1.0 + beta * known)
        self._covariance = (kk - taken * k * k, kb - taken * k * b, bb - taken * b * b)
        self.samples += 1
