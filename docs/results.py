"""The page of the figures of a run, from their table; `make reference` writes it."""

from collections.abc import Iterator

from forcebound.results.figures import FIGURES

_HEAD = """# Results of a run

The table on this page is made from that of the program: `make reference` writes it.

A result begins with a verdict of at most five lines (`simulate`, `launch`, `plot`, `replay`; key `verdict`):

```
Not passive: the hand received up to 194 mJ that it had not put in.
Not at rest: it moves at 110 mm/s at the end, and turned round 222 times after first contact.
Stiffness felt: 7.91 N/mm of 10 N/mm (79%, a mean, since the hand moved); the rest was taken by: saturation 100%.
```

* **Failed** comes first: why the run has exit status 1, such as the line of an environment's, controller's, law's or
  device's code that raised.
* **Passive** of a simulated device is the ground truth: the energy that the hand has put in less what it got back never
  falls below zero (by more than 1 nJ). What was left is its lowest value from first contact on; friction on
  the way to the wall counts. Of a real device no true energy is known. There the line says what the motor alone gave, and
  whether a certificate covers it. *Never gave* is said only if the [error](#the-energy-of-the-motor) of that energy
  allows it. *Passive but for* an energy: the stated `device.allowance`, or what a hand faster than
  `device.hand_speed` can have got.
* **Not covered by the certificate** stands in its place where a certified law ran and the device broke a promise that
  the run shows (`broken_promises`): a force that acted later than `device.write_delay`, for which the ledger had not
  enough, or, without a watchdog, one that lasted longer than `device.watchdog_limit`. It says how often, the median and
  the largest of these, and what to state. What was measured follows. *Covered by the certificate all the same*: forces
  acted later than stated, and the ledger had enough for each of them ([theory.md](theory.md), 3.1). Readings that imply more than `device.largest_speed` are named first, too, but they are refused:
  that costs force alone. Other late holds are priced or dropped, and break none ([theory.md](theory.md), 3.2).
* **At rest**: slower than 1 mm/s over the last 0.5 s.
* **Stiffness felt** is the displayed stiffness of the table, less what a watchdog dropped between two writes, in the unit
  of the launch file. Of a body that moves (`mass_spring`, `bodies`) it is that of the spring between hand and body. The
  [shares](#what-takes-stiffness) of what took the rest add up to 100 %.
* **Why not more**: the first of the [causes](#causes-of-little-force), with a remedy and the stiffness that it would
  give; only if less than 95 % of a known stiffness was felt.
* **Faults**: faults by kind, rejected and lost packets, ticks missed (from 0.1 % on); only if there are any. A run that
  reaches its end with faults has exit status 0, unless it *failed*.

`--all` prints the table of all figures below it; `--json` prints them under the keys given here, in SI units (a key that
ends in `_ms`: in ms).

**Axes that are angles** ([devices.md](devices.md#joint-axes)): tables, plots and verdict are in rad, rad/s, N m and N m/rad.
The keys stay as they are, `units` has the unit of each number whose key names another one (`peak_force_n`: `N m`), and
`axes` the name and the kind of each axis. *At rest* is then slower than 0.01 rad/s: thresholds are those of lengths at a
lever of 0.1 m. Vibration thresholds are known for lengths alone (need *lengths*). Lengths and angles together have no
common size: figures of the whole vector are missing there (need *size*), and `peak_force_by_axis` has those of each axis.

`forcebound plot RUN.mcap` computes them again from a recording. A dash means: not defined for this run (no surface, no
contact, no ground truth); `undefined` has the reason, by key. Under *needs* stands what a run must have for the figure,
beside an engaged force: *truth* is that of a simulated device, *axes* are several, *constant* is a stiffness that does not
change, *mass* is that of the device, *named* are axes with names. The [glossary](glossary.md) defines the terms.
[Sources](#sources) are below.

| row, unit | key | needs | meaning |
|---|---|---|---|
| | `hand` | | name of the hand; `hand`: that of a launch file without `hands` |
"""  # noqa: E501

#: What a figure means, by its key.
MEANINGS = {
    "law": "the bounding law of the device",
    "duration_s": "time since the force engaged for the first time",
    "samples": "samples in that time: ticks in which the device wrote",
    "displayed_stiffness_n_per_m": (
        "mean of applied force over penetration, in contact, 2 to 5 s after engagement; of a "
        "shorter run, its last 40 % (paper, Eq. 33)"
    ),
    "stiffness_n_per_m": (
        "`asked` of the environment, `felt`, and the `shares` of what took the rest, see below; "
        "null where late answers added more than a tenth of what was lost"
    ),
    "displayed_stiffness_share": (
        "`felt` over `asked`, as the verdict says it; null where that is above 1.005 and the hand "
        "is not at rest: a mean of a hand that moves to and fro says nothing"
    ),
    "rate_hardness_n_per_m": (
        "slope of force over slope of penetration in the first 10 ms of the first contact (Eq. 34)"
    ),
    "extended_rate_hardness_n_per_m": (
        "the same with the steepest 10 ms of the first contact's way in: also shows a wall "
        "that answers late, or a damper (Han and Choi 2010; the window is ours)"
    ),
    "transparency_bandwidth_hz": (
        "frequency up to which the displayed impedance is that of the wall, to 3 dB and 45 "
        "degrees. Needs excitation: a hand that moves in contact for 4 s, as in `forcebound "
        "simulate impedance` (Lawrence 1993)"
    ),
    "displayed_impedance": (
        "effective stiffness and damping of the *motor's* force by third-octave band, from 1 "
        "Hz; the device's own mass, damping and friction come on top. A punctual wall has a "
        "damping of -K T/2 (Mehling, Colgate and Peshkin 2005; Colonnese and Okamura 2015)"
    ),
    "peak_force_n": "largest applied force",
    "peak_force_by_axis": "the same on each named axis, in N or N m, by its name",
    "peak_penetration_m": "deepest reading",
    "peak_tangential_force_n": (
        "largest part of the applied force across the normal, in contact. This row and the "
        "next two only if the run has them"
    ),
    "tangential_share": (
        "mean part across over mean part along the normal, in contact, in the steady window "
        "of the displayed stiffness: friction, of a hand that slides"
    ),
    "peak_proxy_distance_m": (
        "longest way from the reading to the proxy, in contact; with friction it is longer "
        "than the penetration"
    ),
    "force_error_rms_n": (
        "commanded force after saturation less applied force, in contact: what the law takes"
    ),
    "wall_error_rms_n": (
        "stiffness times true penetration, less applied force, in contact: what law, delay, "
        "encoder and saturation take"
    ),
    "vibration_above_threshold_db": (
        "strongest third-octave band, 20 to 500 Hz (at 1 kHz: to 400 Hz), of the error to the "
        "ideal wall in the steady window of the displayed stiffness. The band moves the "
        "device's mass; that motion is held against the threshold of vibration (Verrillo "
        "1963). Above 0 dB everybody feels it, under -20 dB nobody"
    ),
    "vibration_frequency_hz": "frequency of that band",
    "vibration": "the spectrum: RMS force and level of each band",
    "settling_time_s": (
        "from first contact until the penetration stays within 5 % of its final value (at "
        "least 0.1 mm); a dash: it never does"
    ),
    "overshoot_share": "deepest penetration over the final one, less 1",
    "limit_cycle_amplitude_m": "half of the range of the position over the last 0.5 s",
    "contact_bounces": (
        "how often the motion turned round after first contact, by more than 0.1 mm: many "
        "bounces are a hand that oscillates, or that taps"
    ),
    "final_speed_m_per_s": "over the last 0.5 s",
    "at_rest": "whether that speed is below 1 mm/s",
    "penetration_at_rest_m": "mean over the last 0.5 s of a hand at rest in contact",
    "true_energy_min_j": (
        "minimum of ∫ F_h v dt, ground truth of a simulated device; below zero, the hand "
        "received energy that it did not put in"
    ),
    "energy_left_j": "lowest energy (ground truth) from first contact on",
    "largest_energy_fall_j": (
        "the most energy (ground truth) that the hand got back at a stretch. A spring that is "
        "released gives back what was put in, so this is no leak; it is what the hand has to "
        "hold against, and with a law that saves energy it may come long after"
    ),
    "energy_regain_time_s": (
        "from the end of that fall until the energy is back; a dash: not in the run"
    ),
    "energy_since_contact_min_j": (
        "lowest energy after first contact, against that at contact less the kinetic energy "
        "brought into it: friction on the way to the wall cannot hide a leak. Below zero in a "
        "passive run: a law spent what it had saved"
    ),
    "observed_energy_min_j": (
        "minimum of the passivity observer at the motor, from readings, applied forces and stamps; "
        "available on hardware (Hannaford and Ryu 2002). Damping and friction of the device are "
        "not in it, so below zero is no leak: a law may give what they are sure to take"
    ),
    "observed_energy_error_j": (
        "by how much the true minimum may be lower: resolution, latch jitter and path between the "
        "readings, see [below](#the-energy-of-the-motor)"
    ),
    "observed_power_min_w": "the most power that the motor gave, mean over 10 samples",
    "observed_deficit_share": "share of the samples in which that observer is below zero",
    "estimated_energy_min_j": (
        "minimum of the law's own ledger. Those of the certified laws are lower bounds of the "
        "energy: below zero, in deficit, no more than the friction force is applied, and the "
        "run is still passive ([theory.md](theory.md))"
    ),
    "ledger_deficit_share": "share of the samples in which the law's own ledger is below zero",
    "bounder_active_share": (
        "of the samples in contact, those whose applied force is smaller than the commanded "
        "force after saturation: the law reduces it"
    ),
    "answered_share": (
        "of the device's ticks, those whose state got a force as its answer, sooner or later; "
        "the others were lost, or overtaken by a newer answer"
    ),
    "same_tick_share": (
        "of the samples with a force, those whose force answers the state of their own tick: "
        "no sample of delay"
    ),
    "loop_delay_ms": (
        "from the sample of the state to the write of the force that answers it, at each "
        "sample with a force; an answer that stays in use for want of a newer one grows "
        "older. (`forcebound delay` counts each answer once, at its first write)"
    ),
    "reply_age_ms": (
        "from the sample of the state that the environment's reply in use answers to the "
        "write of the force, at each sample with a force. Equal to the loop delay, unless the "
        "controller answers states by itself (`local_model`, `virtual_coupling`, ...): then "
        "the loop delay is that of the way between device and controller, and the force is "
        "made of an environment as old as this. A dash: recorded before there was this figure"
    ),
    "deadline_misses": (
        "ticks that were skipped, because the one before was still running or the process was "
        "held up"
    ),
    "hold_limit_overruns": (
        "holds longer than the hold limit of `device.hold_limit`: unless it was guarded the "
        "watchdog had dropped the force, and a certified law paid for it "
        "([realtime.md](realtime.md)). Ticks skipped in a row count once"
    ),
    "hold_limit_ms": (
        "the hold limit in this run, which `device.hold_limit: auto` chooses for each hold"
    ),
    "refused_readings": (
        "readings of the device that could not be: not finite, too soon, or faster than "
        "`device.largest_speed`. Only shown if there are any"
    ),
    "late_writes": (
        "forces that took effect longer after their reading than `device.write_delay`: the "
        "certificate planned for less. Only shown if there are any"
    ),
    "reads_and_writes_s": (
        "what the device's own reads and writes take of each tick, a mean that its process "
        "measures (of older recordings the median of twice the time from reading to write); more "
        "than a period misses ticks, and the verdict says so"
    ),
    "device_misses": "ticks that were missed while the device itself read or wrote",
    "longest_write_delay_ms": "the longest such time",
    "largest_allowance_j": (
        "the most that holds beyond the hold limit can have given the hand (`device.allowance`)"
    ),
    "allowance_repaid": "whether the ledger has it back, and what a faster hand can have got",
    "fast_holds": (
        "intervals between two readings, with a force above friction, in which the hand moved "
        "faster than `device.hand_speed`. Only shown if there are any"
    ),
    "speed_leak_j": "the most energy that the hand can have got in them",
    "energy_cap_j": (
        "most energy that a certified law keeps for later: `device.energy_cap`, else as much "
        "as the saturation can use (null)"
    ),
    "number_sources": (
        "how many of its numbers are measured, from a data sheet, or assumed (`device.sources`)"
    ),
    "broken_promises": (
        "promises of the device that the run breaks, of a certified law: `promise` (a key of "
        "`device`), the `stated` number, the `typical` (median) and `largest` beyond it in `unit`, "
        "`count` of how many (`of`), and whether the certificate covers it all the same (`is_paid`)"
    ),
    "little_force": (
        "[causes](#causes-of-little-force) of a stiffness felt that is less than 95 % of that "
        "asked, each `cause` with the `advice` in the lines below the table; `data` has what it "
        "`takes` and what its remedy `gives`, in N/m"
    ),
    "rejected_packets": (
        "packets that the device rejected, by reason ([protocol.md](protocol.md))"
    ),
    "links": "packets that impaired links lost or damaged on purpose",
    "packets_saved": (
        "packets that links with a `deadband` did not send, by topic "
        "([impairments.md](impairments.md#deadband))"
    ),
    "faults": "faults, by kind ([device-safety.md](device-safety.md#when-a-process-ends-or-hangs))",
}

_TAIL = """
## What takes stiffness

The force of a wall passes several stages, and at each sample in contact (of the steady window) the last one that made it
smaller took what is missing: without an earlier one the hand would have felt no more.

| share | what is missing where |
|---|---|
| *a cause*, little dissipation | the law cut the force: what it lacked, see below; `law` where that is not known |
| saturation | the motor could not give more, and the law left that as it was |
| engage ramp | nothing cut it: the force still came over `device.engage_time` |
| late answers | nothing cut it: the answer in use is of an earlier, shallower place. And what they take by emptying the ledger |
| missing answers | no answer was in use: none had come, or it was older than `device.age_limit` |
| missed ticks | a silent or reporting watchdog had dropped the force of a late tick until the next write; and what a certified law gives less because ticks were late |
| controller or environment | neither: the controller changes the answer, or the environment is more than a spring |

Of a run whose law was changed, the share of missed ticks has only the dropped force. Of a hand that moves, the
stiffness felt is a mean and means little.

## Causes of little force

What would the hand have felt without a delay, with another watchdog limit, at another rate? The program computes that:
the *twin* of a run (`forcebound/results/twin.py`) feeds the bounder the recorded readings and commands once more, with
one number changed, and moves the hand by what the other force does to its mass, damping and stiffness (those of the
simulated hand; of a person, those of a soft grip). With the numbers of the run the twin is the run. A cause *takes* what
the twin without it feels more, and its remedy *gives* what the twin with the remedy feels.

| cause | what it is | remedy, whose stiffness is named |
|---|---|---|
| `watchdog_limit` | no watchdog, so a force must be safe for `device.watchdog_limit`, but for `device.allowance` | a limit of 30 ms at most, and the smallest allowance that gives nearly the most |
| `write_delay` | a force acts later than its reading, as stated (`device.write_delay`) or recorded | half of it |
| `lag`, `presliding`, `gain_error`, `weight_error`, `resolution` | numbers of the device, with their price ([prices.md](../proofs/docs/prices.md)) | half of it |
| `hold_limit` | a fixed `device.hold_limit` | `auto` |
| `missed_ticks` | ticks that were late or missed; if the device's own reads and writes take more than a period, that is said | punctual ticks; else a `device.rate` that the device can keep |
| `late_answers` | half of the answers are older than a period, or some are missing | answers at once |
| `soft_controller` | `virtual_coupling` and `wave_variables` have a spring of their own, in series with the wall | a larger `impedance` or `stiffness`; or `direct` with a certified law |
| `energy_cap` | the ledger may not keep more | `auto` |
| `fading` | `certified_fading` forgets what the hand has put in | `certified` |
| `law_not_certified` | another law gives less than `certified` would | `certified` |
| `saturation` | of the motors | motors of twice that |
| `engage_ramp` | the force was still coming | a longer run |
| `opposite_sign` | the commanded force grows with the depth, and pulls the hand deeper | the opposite of its force |
| `dissipation` | what is left: the law gives what the device's damping and friction, and the motion of the hand, pay for | half or twice `device.rate`, if one of them gives more; else more damping, or a softer environment, which would feel the same |

The avoidable causes come first, by what each takes; `dissipation` comes last, where it is more than half of the loss. A
cause that takes less than a tenth of the stiffness felt is left out, unless it is half of the loss. In the cases of
`tests/test_little_force.py`, each run again with the remedy, the stiffness named is within 10 % of that felt. Without a
known stiffness, and for hands that exchange energy, no cause is named.

## The energy of the motor

Each force is paired with the path from the time at which it began to act (`write_ns`, later by the stated lag) to that
at which the next one did, or at which the watchdog dropped it. Positions are interpolated between the readings at
their times (`read_ns`); those of an arm are its angles, with torques. An error d of a position where the force changes
by ΔF is one of the energy by ΔF d at most. d has three parts: half of `device.resolution`; the hand's speed times
the latch jitter that the device reports, or, if it reports none, times all of the time from the reading to the write; and
an estimate of how far the path departs from a straight line between two readings (a quarter of their second difference).

## More

**Two and three axes.** An environment that has a proxy says with each answer where it is, and the normal of the surface
there. Penetration and the forces of displayed stiffness, rate-hardness, vibration and impedance are then those along
that normal, at the position that was asked about; a tick without an answer has the surface of the newest one before it,
and a hand in free motion is measured from the plane that it touched last. So the figures hold for a curved surface and
for one that moves or changes. Of an environment that does not say it, they are those of the flat wall that the launch
file describes (`environment.position`, a number, and `.axis`). Other forces are the size of the whole vector. Behind
the controller `scaled` they are those that the hand feels: a place X of the environment is at (X - origin) / s, a
stiffness k is s_f s k. With a clutch or a border no such place stays, and all that needs a surface is a dash.

`interrupted` is true if the run was ended before its time. `phases` lists the phases of a scripted run.

**Phases.** With `phases:` in the launch file, a second table has a row for each phase.

| column | key | meaning |
|---|---|---|
| phase | `name`, `start_s`, `duration_s` | start is counted from engagement |
| delay, ms | `loop_delay_ms` | p50/p99/max |
| age of reply, ms | `reply_age_ms` | p50/p99/max |
| answered | `answered_share` | ticks answered |
| force on | `force_share` | share of the samples with an engaged force |
| peak force | `peak_force_n` | |
| minimum energy | `true_energy_min_j` | minimum energy (ground truth) in the phase |
| | `deadline_misses` | in the phase |

**Several laws.** A run whose law was changed (`forcebound param set`, *Make it safe* on the live page) has a column for each
law's time, under its name and the time at which it began; `--json` has them as `laws`, with `start_s`. In each, time and
energy (ground truth) count from its beginning. The column of the whole run has a dash for every figure that would mix
laws; what is counted over all of them (rejected, lost or damaged packets, the bounder's report) stands there alone.

**Exit status.** 1 if no force engaged or the environment answered no tick, if code of an environment, controller, law,
device or hand failed (also if it failed once), and if a live run failed, such as a node that
does not stop at the planned end: the result of what was recorded is shown before the error.

**Plots.** With several axes the position panel shows each, under its name (x, y, z), beside the proxy; the force panel the
size of the whole vector, against the limit, which is one of the whole vector; two more panels the path of tip and proxy,
seen along z and along y. The force panel shows the commanded force (after age limit and engage ramp, before saturation), the applied force,
and as a band the limit force. The panel of the loop delay has a second curve, the age of the reply, where it differs. Vertical lines are faults and changes, by kind, named in the legend of the first panel;
blue bands are phases. A run whose *true* energy enters the red area below zero is not passive; the estimated energy of a
certified law may enter it (see above).

**Two runs.** `forcebound plot A.mcap B.mcap` also says whether a hand feels the difference to the first run: stiffness
from 23 % on (Jones and Hunter 1990), force from 7 % on (Pang, Tan and Durlach 1991). `--json` has it as `differences`.

## Sources

* Colonnese, Okamura, "Rendered and characterized closed-loop accuracy of impedance-type haptic displays", IEEE
  Transactions on Haptics 8(4), 2015.
* Han, Choi, "Extended rate-hardness: a measure for perceived hardness", EuroHaptics 2010, LNCS 6191.
* Hannaford, Ryu, "Time-domain passivity control of haptic interfaces", IEEE Trans. Robotics and Automation 18(1),
  2002, Eq. 6.
* Jones, Hunter, "A perceptual analysis of stiffness", Experimental Brain Research 79, 1990.
* Lawrence, "Stability and transparency in bilateral teleoperation", IEEE Trans. Robotics and Automation 9(5), 1993.
* Lawrence et al., "Rate-hardness: a new performance metric for haptic interfaces", IEEE Trans. Robotics and Automation
  16(4), 2000.
* Mehling, Colgate, Peshkin, "Increasing the impedance range of a haptic display by adding electrical damping", World
  Haptics 2005.
* Pang, Tan, Durlach, "Manual discrimination of force using active finger motion", Perception and Psychophysics 49(6),
  1991.
* Verrillo, "Effect of contactor area on the vibrotactile threshold", J. Acoustical Society of America 35, 1963: 0.1 um
  (peak) at 250 Hz, 12 dB per octave below down to 40 Hz, 9 dB above. A hand that grasps a handle is up to ten times as
  sensitive: Brisben, Hsiao, Johnson, "Detection of vibration transmitted through an object grasped in the hand", J.
  Neurophysiology 81, 1999.

**Next**: [real time](realtime.md), if ticks were missed; [recordings](recordings.md), to look at a run again.
"""  # noqa: E501


def results_page() -> str:
    """Return the page in Markdown."""
    return _HEAD + "\n".join(_rows()) + "\n" + _TAIL


def _rows() -> Iterator[str]:
    for figure in FIGURES:
        unit = figure.unit.unit if figure.label and figure.cell is None else ""
        label = f"{figure.label}, {unit}" if unit else figure.label
        needs = figure.needs.of_run.replace("force", "").strip().replace(" ", ", ")
        yield f"| {label} | `{figure.key}` | {needs} | {MEANINGS[figure.key]} |"


if __name__ == "__main__":
    print(results_page(), end="")
