from my_driver import Driver

from arva_hil import Bench


def test_the_driver_forgets_a_transmitter_that_is_silent(arva_bench: Bench) -> None:
    driver = Driver(arva_bench.serial())
    arva_bench.place_vehicle(north=15, east=5, down=-2)
    arva_bench.advance(seconds=2)
    driver.update(arva_bench.now())
    assert driver.distance_m is not None
    assert abs(driver.distance_m - arva_bench.truth().ranges_m[1]) < 1
    arva_bench.inject("transmitter_off=1")
    arva_bench.advance(seconds=2)
    driver.update(arva_bench.now())
    assert driver.distance_m is None
