"""Scenario files: what is right loads and dumps to the same, what is wrong is told by field, value and line."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

from zengrid.errors import ScenarioError
from zengrid.scenario import BUILTIN, Days, HomeSpec, Scenario, dumps, load, loads

Write = Callable[[str, str], Path]


@pytest.mark.parametrize("name", [name for name in BUILTIN if name != "fontana"])
def test_a_dump_loads_to_the_same_scenario(name: str) -> None:
    scenario = load(name)
    again = loads(dumps(scenario))
    assert again == scenario
    assert dumps(again) == dumps(scenario)
    assert again.home_ids == scenario.home_ids


def test_a_dump_is_complete(paper: Scenario) -> None:
    fields = yaml.safe_load(dumps(paper))
    assert set(fields) == set(Scenario.model_fields)
    assert fields["noise"] == {"cloudiness": 0.1, "load_level": 0.05, "load_noise": 0.05}


def test_unknown_names_are_answered_with_those_that_exist() -> None:
    with pytest.raises(ScenarioError, match=r"'papre'.*permitted: paper, fontana, village, city, or the path"):
        load("papre")


def test_a_seed_replaces_the_scenarios_own() -> None:
    assert load("paper", seed=7).seed == 7


def test_fontana_without_data_says_where_to_get_it() -> None:
    with pytest.raises(ScenarioError, match=r"CityLearn Challenge 2022.*intelligent-environments-lab/CityLearn"):
        load("fontana")
    with pytest.raises(ScenarioError, match="/nowhere: is not a folder"):
        load("fontana", data=Path("/nowhere"))


def test_data_for_a_scenario_that_takes_none_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"uses no measured data.*given: /x"):
        load("paper", data=Path("/x"))


WRONG = {
    "homes: []": r"market.yaml, line 7: homes: none; needed",
    "homes: [{id: a}, {id: a}]": r'line 7: homes: "a" appears twice',
    "homes: [{id: grid}]": r'line 7: homes: id "grid" is that of the grid agent',
    "homes: [{id: A}]": r"line 7: homes.0.id = 'A': permitted: text like p1",
    "homes: [{id: a, pv: 3}]": r"line 7: homes.0.pv: there is no such field; permitted: id, pv_kw, tilt_deg",
    "homes:\n  - id: a\n    battery:\n      soc_max: 1.2": r"10: homes.0.battery.soc_max = 1.2: permitted: .* 1$",
    "homes: [{id: a}]\nslot_minutes: 7": r"line 8: slot_minutes = 7: permitted: a divisor of .* such as 6 or 8",
    "homes: [{id: a}]\nslot_minutes: 0": r"line 8: slot_minutes = 0: permitted: a whole number from 1 to 1440",
    "homes: [{id: a}]\nslot_minutes: x": r"line 8: slot_minutes = 'x': permitted: a whole number from 1 to 1440",
    "homes: [{id: a}]\nfleets: 2": r"line 8: fleets = 2: permitted: 1 to 1, the number of homes",
    "homes: [{id: a}]\nsoc_reset: weekly": r"line 8: soc_reset = 'weekly': permitted: daily, never",
    "homes: [{id: a}]\nbuy_prices: [0.2, 0.1]": r"line 8: buy_prices = .*permitted: increasing prices",
    "homes: [{id: a}]\ndata: {kind: xml}": r"line 8: data.kind = 'xml'; permitted: kind builtin, caiso, citylearn, csv",
    "homes: [{id: a}]\ndata: {kind: csv}": r"line 8: data.path: missing; needed: text",
    "homes: [{id: a}]\nnoise: {cloudiness: .nan}": r"line 8: noise.cloudiness = nan: permitted: a number from 0 to 1",
    "homes: [{id: a}]\nsite: {latitude: 91}": r"line 8: site.latitude = 91: permitted: a number from -90 to 90",
    "homes: [{id: a}]\nname: again": r"line 8: name appears twice; permitted: once",
    "homes: [{id: a}\nfleets: 3": r"line 8: is not YAML",
}


@pytest.mark.parametrize(("homes", "message"), WRONG.items(), ids=list(WRONG))
def test_a_wrong_file_is_told_by_line_field_and_value(write: Write, homes: str, message: str) -> None:
    text = "name: mine\ntariff:\n  - from: 00:00\n    price: 0.1\nfacilities:\n  - {name: base, max_kw: 9, b: 0.03}\n"
    path = write("market.yaml", text + homes)
    with pytest.raises(ScenarioError, match=message) as caught:
        load(path)
    told = [line for line in str(caught.value).splitlines() if "site." not in line]
    assert len(told) <= 1
    assert str(caught.value).startswith(str(path))


def test_several_faults_are_several_lines(write: Write) -> None:
    path = write("market.yaml", "name: X\nseed: -1\nfoo: 2\n")
    with pytest.raises(ScenarioError) as caught:
        load(path)
    lines = str(caught.value).splitlines()
    assert [line.removeprefix(f"{path}, ").split(" ")[:3] for line in lines[:1]] == [["line", "1:", "name"]]
    assert any("line 2: seed = -1: permitted: a whole number from 0" in line for line in lines)
    assert any("line 3: foo: there is no such field" in line for line in lines)
    assert any("tariff: missing; needed: a list of 1 to 1440" in line for line in lines)
    assert len(lines) == 5


@pytest.mark.parametrize("text", ["", "- 1\n", "text\n", "name: [", "\x00"])
def test_what_is_no_scenario_is_refused(write: Write, text: str) -> None:
    with pytest.raises(ScenarioError, match=r"market.yaml"):
        load(write("market.yaml", text))


def test_many_faults_are_cut_off() -> None:
    with pytest.raises(ScenarioError, match=r"and 20 more$"):
        loads("{" + ", ".join(f"f{i}: 1" for i in range(27)) + "}")


class TestTariff:
    def scenario(self, tariff: str, minutes: int = 60) -> Scenario:
        return loads(
            f"{{name: x, slot_minutes: {minutes}, tariff: [{tariff}], homes: [{{id: a}}],"
            "facilities: [{name: base, max_kw: 9, b: 0.03}], data: {kind: builtin, name: paper}}"
        )

    def test_times_may_stand_without_quotes(self) -> None:
        scenario = self.scenario("{from: 00:00, price: 1}, {from: 11:00, price: 2}, {from: 17:00, price: 3}")
        assert scenario.sell_prices == (1.0,) * 11 + (2.0,) * 6 + (3.0,) * 7

    @pytest.mark.parametrize(
        ("tariff", "message"),
        [
            ("{from: '01:00', price: 1}", 'begins at 01:00; needed: a price from "00:00" on'),
            ("{from: '00:00', price: 1}, {from: '11:30', price: 2}", "11:30 lies within a slot"),
            ("{from: '00:00', price: 1}, {from: '00:00', price: 2}", "00:00 after 00:00; permitted: increasing"),
            ("{from: '24:00', price: 1}", "tariff.0.from = '24:00': permitted: text like 11:00"),
            ("{from: '00:00', price: -1}", "tariff.0.price = -1: permitted: a number from 0 to 1000"),
        ],
    )
    def test_impossible_times_are_refused(self, tariff: str, message: str) -> None:
        with pytest.raises(ScenarioError, match=message):
            self.scenario(tariff)

    def test_half_hours_need_half_hour_slots(self) -> None:
        prices = self.scenario("{from: '00:00', price: 1}, {from: '11:30', price: 2}", minutes=30).sell_prices
        assert prices.index(2.0) == 23


class TestWith:
    def test_changes_are_validated_and_leave_the_original(self, paper: Scenario) -> None:
        assert paper.with_(seed=3, noise="off").seed == 3
        assert paper.seed == 0
        with pytest.raises(ScenarioError, match="seed = -1: permitted"):
            paper.with_(seed=-1)

    def test_paths_lead_into_fields(self, paper: Scenario) -> None:
        changed = paper.with_(**{"homes.1.battery.capacity_kwh": 20, "noise.cloudiness": "0.3"})
        assert [home.battery.capacity_kwh for home in changed.homes] == [6, 20, 8]
        assert changed.noise.cloudiness == 0.3

    def test_a_star_stands_for_all(self, paper: Scenario) -> None:
        changed = paper.with_(**{"homes.*.battery.capacity_kwh": 25, "homes.*.battery.initial_kwh": None})
        assert {home.battery.capacity_kwh for home in changed.homes} == {25}

    def test_homes_that_are_changed_are_no_longer_drawn(self) -> None:
        village = load("village")
        changed = village.with_(**{"homes.*.battery.capacity_kwh": 7})
        assert {home.battery.capacity_kwh for home in changed.homes} == {7}
        assert [home.pv_kw for home in changed.homes] == [home.pv_kw for home in village.homes]
        assert loads(dumps(changed)) == changed

    @pytest.mark.parametrize(
        ("path", "message"),
        [
            ("homes.3.pv_kw", "there is no member 3; permitted: 0 to 2"),
            ("homes.x.pv_kw", "there is no member x"),
            ("seed.x", "x is inside a single value"),
            ("nois.cloudiness", "nois: there is no such field"),
            ("noise.cloud", "noise.cloud: there is no such field; permitted: cloudiness, load_level, load_noise"),
        ],
    )
    def test_wrong_paths_are_reported(self, paper: Scenario, path: str, message: str) -> None:
        with pytest.raises(ScenarioError, match=message):
            paper.with_(**{path: 1})


def test_agents_are_homes_or_fleets_of_neighbours(paper: Scenario) -> None:
    assert paper.agents == (("p1", ("p1",)), ("p2", ("p2",)), ("p3", ("p3",)))
    assert paper.with_(fleets=2).agents == (("fleet1", ("p1",)), ("fleet2", ("p2", "p3")))
    village = load("village")
    assert [len(agent.homes) for agent in village.agents] == [50, 50]
    assert sum((agent.homes for agent in village.agents), ()) == village.home_ids


def test_the_market_is_the_papers(paper: Scenario) -> None:
    market = paper.market()
    assert market.dt_h == 1.0
    assert market.homes.capacity_kwh.tolist() == [6, 12, 8]
    assert (market.homes.soc_initial * market.homes.capacity_kwh).tolist() == pytest.approx([3, 4, 3.5])
    assert market.facilities.p_max_kw.tolist() == [20, 50]
    assert market.facilities.p_min_kw.tolist() == [5, 0]
    assert market.facilities.cost_a.tolist() == [0, 0.012]


def test_relative_paths_count_from_the_scenario_file(write: Write, tmp_path: Path) -> None:
    write("data.csv", "time,a_load_kw\n" + "".join(f"{h:02d}:00,1\n" for h in range(24)))
    text = "name: x\ntariff: [{from: 00:00, price: 1}]\nfacilities: [{name: b, max_kw: 9, b: 1}]\n"
    scenario = load(write("market.yaml", text + "homes: [{id: a}]\ndata: {kind: csv, path: data.csv}\n"))
    again = loads(dumps(scenario), folder=Path("/"))
    assert Days(again).day(0).load_kw.sum() == 24
    write("data.csv", "time,a_load_kw\n" + "".join(f"{h:02d}:00,2\n" for h in range(24)))
    with pytest.raises(ScenarioError, match=r"the content has changed .SHA-256"):
        Days(again)
    assert Days(scenario).day(0).load_kw.sum() == 48


def test_a_home_from_the_wire_is_a_home_of_a_file(paper: Scenario) -> None:
    assert HomeSpec.model_validate_json(paper.homes[0].model_dump_json()) == paper.homes[0]


@pytest.mark.parametrize("text", ["[" * 100_000, "- " * 100_000, "{a: " * 100_000, "a: " + "[" * 50 + "]" * 50])
def test_what_is_nested_without_end_is_refused(text: str) -> None:
    with pytest.raises(ScenarioError, match="line 1: nested deeper than 50 levels"):
        loads(text)


def test_aliases_that_multiply_are_told_in_short() -> None:
    names = "abcdefghij"
    layers = [f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]" for before, name in pairwise(names)]
    text = "\n".join(["a: &a [x, x, x, x, x, x, x, x, x]", *layers, "name: *j", "homes: *j"])
    with pytest.raises(ScenarioError, match=r"name = \[+\.\.\.") as error:
        loads(text)
    assert len(str(error.value)) < 5000


def test_numbers_with_an_exponent_are_numbers_and_texts_like_them_stay_texts(paper: Scenario) -> None:
    fields = yaml.safe_load(dumps(paper))
    fields["homes"][0] |= {"id": "1e1", "pv_kw": 4.0}
    text = dumps(loads(yaml.safe_dump(fields).replace("id: 1e1", "id: '1e1'").replace("pv_kw: 4.0", "pv_kw: 1e1", 1)))
    again = loads(text)
    assert (again.homes[0].id, again.homes[0].pv_kw) == ("1e1", 10.0)
    assert dumps(again) == text


@pytest.mark.parametrize("wrong", ["5", "true", "'5'", "1.0.0"])
def test_in_a_home_a_number_is_a_number(paper: Scenario, wrong: str) -> None:
    text = dumps(paper).replace("capacity_kwh: 6.0", f"capacity_kwh: {wrong}", 1)
    if wrong == "5":
        assert loads(text).homes[0].battery.capacity_kwh == 5.0  # whole numbers need no point
    else:
        with pytest.raises(ScenarioError, match=r"homes\.0\.battery\.capacity_kwh = .*: permitted: a number from 0"):
            loads(text)


def test_texts_that_a_log_could_not_show_are_refused(paper: Scenario) -> None:
    fields = yaml.safe_load(dumps(paper))
    fields["homes"][0]["load"] = {"profile": "p1\x1b[2J"}
    with pytest.raises(ScenarioError, match=r"homes\.0\.load\.profile: permitted are printable characters"):
        loads(yaml.safe_dump(fields))
