"""The fake is a plant: every attribute of the protocol is there, with its parameters."""

import inspect

from fake_plant import FakePlant

from controller.plant.plant import Plant


def test_the_fake_has_each_method_of_the_plant_with_its_parameters() -> None:
    asked = {
        name: [*inspect.signature(method).parameters]
        for name, method in vars(Plant).items()
        if inspect.isfunction(method) and not name.startswith("_")
    }
    assert asked
    for name, parameters in asked.items():
        assert [*inspect.signature(getattr(FakePlant, name)).parameters] == parameters, name
