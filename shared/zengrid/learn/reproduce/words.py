"""What the report says about its figures and tables, and what the paper leaves open."""

from __future__ import annotations

CAPTIONS = {
    "comparison": (
        "The paper's five figures: the change against the conventional market, on days that no training saw."
    ),
    "waveforms": (
        "What the day brings: the case study's profiles without noise. Days in training and evaluation vary: clouds "
        "take 10 % of the sun on average, loads vary by 5 % from day to day and from hour to hour."
    ),
    "day": (
        "The day without noise, after training, beside the conventional market. Bold lines are one seed, in the "
        "middle of all by the grid's profit; areas hold all seeds."
    ),
    "over-training": (
        "How good the agents are while they learn, without random actions, on days apart from training: medians of "
        "the seeds, and areas from the smallest to the largest. Fine dots: the same days without demand response."
    ),
    "learning-curves": (
        "Learning curves: the reward that agents accumulate in a day of training, random actions included, as a "
        "moving average over five rounds of days played side by side. Medians of the seeds, and areas from the "
        "smallest to the largest."
    ),
    "capacity-bills": (
        "Bills over the size of every battery. Each size is trained anew with every seed. The leader reference is "
        "where a perfectly informed grid and best-responding homes end up; a grid that pays more leaves smaller bills "
        "than that."
    ),
    "capacity-grid": (
        "Grid profit and reserve energy over the size of every battery. The thin upright line is where the paper sees "
        "its curves flatten."
    ),
}
"""By the name of the figure, in order."""

LEFT_OPEN = (
    (
        "The paper prints no curves of PV, consumption and the plain consumer (it derives them from California ISO) "
        "and no cost functions of the facilities. Curves, cost coefficients and the noise from day to day are "
        "zengrid's own. They were chosen so that fully informed selfish players <em>can</em> reach gains of the size "
        "that the paper reports; whether agents that learn get there is what is measured here. Nothing here speaks "
        "about the paper's own input."
    ),
    ("Equations 12 and 17 as printed make importing energy profitable: their sign is mended, buying costs."),
    ("Battery capacity, which Table I prints in kW, is in kWh."),
    ("Costs and payments that the grid agent observes are those of the last settled slot."),
    (
        "Learning settings are zengrid's (the paper prints none), and with the observation <code>public</code> agents "
        "see more than in the paper's equations 14 and 15: the time of day and the posted sell price."
    ),
    (
        "With every battery of one size, each home begins the day with the usable energy that it has in the case "
        "study, as far as the battery holds it. The paper does not say what it does."
    ),
)

TABLE = (
    "Percentages are changes against the conventional market on the same days; the last three columns are the "
    "amounts. <em>Leader reference</em>: the best price schedule that a search finds, with homes that know it in "
    "advance and best-respond among the commands that agents have. <em>Best response</em>: the smallest bill a home "
    "could have had under the prices that our trained grid set, knowing the day in advance; <em>gap</em>: what that "
    "would still have saved, in per cent of what the agent saved. The grid's profit falls short of the leader "
    "reference by {short} (negative: beyond it; homes that do not play best responses may let a grid earn more)."
)

FLAT = (
    "The smallest of the trained sizes from which on the curve stays near its value at the largest: within 10 % of its "
    "whole change, about as much as seeds differ. Ours is the curve in the middle of the seeds, with the range of "
    "single seeds. The paper says that its curves slow down at about 15 kWh, and has none for reserve energy."
)
