"""The methods that ask a motion library, each with the settings that validation chose for it.

They share the loop, the library, the search and the solver; only the local model and its settings differ. The settings
come from `poseloom benchmark sweep` on sequences that no table reports, with as many trials for each method.
"""

from math import radians
from typing import ClassVar

from poseloom.library.features import FeatureSettings
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
    """The nearest moments' mean and covariance, conditioned on the sensors by the solver.

    See `GaussianModel` for why nothing is regressed. Arguments as for `NeighbourMethod`.
    """

    default_model: ClassVar[LocalModel] = GaussianModel(shrinkage=0.7)
    default_neighbours: ClassVar[NeighbourSettings] = NeighbourSettings(
        neighbours=32, angle_floor=radians(0.5), persistence=0.5
    )


class LocalRegression(NeighbourMethod):
    """The six-sensor paper's method, mended: see `SubspaceModel`. Arguments as for `NeighbourMethod`."""

    default_model: ClassVar[LocalModel] = SubspaceModel(energy=0.8, ridge=0.1)
    default_neighbours: ClassVar[NeighbourSettings] = NeighbourSettings(
        bandwidth=0.4, persistence=0.3, angle_floor=radians(0.5)
    )


class LocalPcr(NeighbourMethod):
    """Liu et al. 2011: see `PcrModel`. Arguments as for `NeighbourMethod`."""

    default_model: ClassVar[LocalModel] = PcrModel(ridge=0.1)
    default_neighbours: ClassVar[NeighbourSettings] = NeighbourSettings(
        neighbours=96, bandwidth=0.4, angle_floor=radians(0.25)
    )
    default_features: ClassVar[FeatureSettings] = FeatureSettings()


class LocalPca(NeighbourMethod):
    """Chai and Hodgins 2005: see `PcaModel`. Arguments as for `NeighbourMethod`."""

    default_model: ClassVar[LocalModel] = PcaModel(energy=0.999)
    default_neighbours: ClassVar[NeighbourSettings] = NeighbourSettings(
        bandwidth=0.7, angle_floor=radians(2.0), persistence=0.4
    )


class NearestExample(NeighbourMethod):
    """The nearest moment's pose, bent to the sensors: see `NearestModel`. Arguments as for `NeighbourMethod`."""

    default_model: ClassVar[LocalModel] = NearestModel()
    default_neighbours: ClassVar[NeighbourSettings] = NeighbourSettings(neighbours=64, bandwidth=0.7, persistence=0.4)
    default_features: ClassVar[FeatureSettings] = FeatureSettings()
