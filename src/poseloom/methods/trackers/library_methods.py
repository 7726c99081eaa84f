"""The methods that ask a motion library, each with the settings that validation chose for it.

They share the loop, the library, the search and the solver; only the local model and its settings differ. The settings
were chosen by `poseloom benchmark sweep` on sequences that no table reports, with as many trials for each method.
"""

from typing import ClassVar

from poseloom.methods.trackers.local_models import (
    GaussianModel,
    LocalModel,
    NearestModel,
    PcaModel,
    PcrModel,
    SubspaceModel,
)
from poseloom.methods.trackers.neighbours import NeighbourMethod, NeighbourSettings


class LocalGaussian(NeighbourMethod):
    """The recommended method: the nearest moments' mean and covariance, conditioned on the sensors by the solver.

    See `GaussianModel` for why nothing is regressed. Arguments as for `NeighbourMethod`.
    """

    default_model: ClassVar[LocalModel] = GaussianModel()


class LocalRegression(NeighbourMethod):
    """The six-sensor paper's method, mended: see `SubspaceModel`. Arguments as for `NeighbourMethod`."""

    default_model: ClassVar[LocalModel] = SubspaceModel()


class LocalPcr(NeighbourMethod):
    """Liu et al. 2011: see `PcrModel`. Arguments as for `NeighbourMethod`."""

    default_model: ClassVar[LocalModel] = PcrModel()


class LocalPca(NeighbourMethod):
    """Chai and Hodgins 2005: see `PcaModel`. Arguments as for `NeighbourMethod`."""

    default_model: ClassVar[LocalModel] = PcaModel()


class NearestExample(NeighbourMethod):
    """The nearest moment's pose, bent to the sensors: see `NearestModel`. Arguments as for `NeighbourMethod`."""

    default_model: ClassVar[LocalModel] = NearestModel()
    default_neighbours: ClassVar[NeighbourSettings] = NeighbourSettings(neighbours=64)
