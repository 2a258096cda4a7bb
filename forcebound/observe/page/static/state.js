// The state of the graph in words, from the frames that the page gets. No element of the page is used here.

import { joule, text } from "./scale.js";

const MEMORY = 2; // s of frames that are looked at
const STILL = 0.5; // s for which a hand at rest has not moved
const REST = 3e-4; // m that a hand at rest may move in that time
const LEAST_ENERGY = 1e-4; // J; less is the resolution of the account
const LEAST_FORCE = 0.02; // N; less is no contact
const BOUNCE = 0.25; // s without a force that a hand which bounces may be in the air
const WHOLE = 0.95; // share of the commanded force from which on nothing is missing
const LATE = 0.02; // share of missed ticks that a hand can feel
const LASTING = 0.02; // s of missed ticks in one contact that a hand can feel

export const magnitude = (vector) => (vector.length === 1 ? vector[0] : Math.hypot(...vector)); // on one axis with its sign

export class State {
  constructor() { this.begin({ period: 1e-3 }); }

  /** Begin with a graph whose ticks are `period` apart, in s. */
  begin({ period }) { Object.assign(this, { period, law: "certified", reason: "", broken: "", holder: "the hand", since: NaN, past: [], missedBefore: null, contact: null }); }

  /** Take a frame in: the newest samples, all in SI units. */
  take(frame) {
    if (frame.since !== this.since) Object.assign(this, { since: frame.since, past: [], broken: "" }); // another law
    const time = frame.time.at(-1), axes = frame.position[0].map((_, axis) => frame.position.map((x) => x[axis]));
    this.frame = frame;
    this.law = frame.law || this.law;
    this.past.push({ time, misses: frame.misses, energy: energyOf(frame),
      low: axes.map((all) => Math.min(...all)), high: axes.map((all) => Math.max(...all)) });
    this.past = this.past.filter((one) => one.time > time - MEMORY && one.time <= time);
    this.force = Math.hypot(...frame.applied.at(-1));
    const asked = frame.commanded.map((force) => Math.hypot(...force)), newest = asked.findLastIndex((force) => force >= LEAST_FORCE);
    if (newest >= 0) this.contact = { time: frame.time[newest], asked: asked[newest], given: Math.hypot(...frame.applied[newest]) };
    else if (this.contact && time - this.contact.time > BOUNCE) this.contact = null;
    if (this.contact) this.missedBefore ??= frame.misses;
    else this.missedBefore = null;
  }

  /** What was before `age` seconds, or the earliest that is known of this law. */
  before(age) { return this.past.find((one) => one.time >= this.past.at(-1).time - age) ?? this.past[0]; }

  /** How far the hand has moved in the last moment, in m: on the axis on which it is most. */
  get moved() {
    const seen = this.past.filter((one) => one.time > this.past.at(-1).time - STILL);
    return Math.max(...seen[0].low.map((_, i) => Math.max(...seen.map((one) => one.high[i])) - Math.min(...seen.map((one) => one.low[i]))));
  }

  /** Share of the ticks of the last seconds that was missed. */
  get missed() {
    const [first, last] = [this.past[0], this.past.at(-1)];
    return (last.misses - first.misses) * this.period / Math.max(last.time - first.time, STILL);
  }

  /** {kind, head, more}: the state as a word for the colour, as a sentence, and what explains it. */
  words(surface = "surface") {
    const { delay, engagement } = this.frame, lost = Math.round(100 * this.missed);
    if (delay.at(-1) === null) return { kind: "off", head: "No force.", more: "Controller or environment does not answer." };
    if (engagement < 1) return { kind: "off", head: `The force engages: ${Math.round(100 * engagement)} %.`, more: "" };
    const energy = this.past.at(-1).energy, isContact = this.contact !== null, { asked, given } = this.contact ?? { asked: 0, given: 0 };
    const isShort = given < WHOLE * asked;
    const share = `${text(given)} N of the ${text(asked)} N that the ${surface} commands`;
    const late = this.missed >= LATE ? ` ${lost} % of the ticks are missed.` : "";
    const isTrue = this.frame.true_energy.at(-1) !== null; // a real device has no ground truth: only its motor is known
    const isReceived = energy < -LEAST_ENERGY && isTrue;
    if (this.broken && !isReceived) return { kind: "late", head: "Not covered by the certificate.", more: `${this.broken}.${late}` };
    if (energy < -LEAST_ENERGY && !isTrue) {
      return { kind: "off", head: `The motor gave ${joule(-energy)} more than it took.`,
        more: `The device's own friction may have taken that.${late}` };
    }
    if (isReceived) {
      const isFed = this.before(1).energy - energy > Math.max(LEAST_ENERGY, -0.01 * energy) && this.moved > REST;
      return { kind: "unstable", head: `${isFed ? "Unstable" : "Not passive"}: ${this.holder} received ${joule(-energy)}.`,
        more: `${this.broken && `${this.broken}. `}Law ${this.law}${isFed ? ": the hand swings, and each swing takes energy out of the motor" : ""}.${late}` };
    }
    if (late && isShort && this.law !== "none" && (!this.reason || this.reason.includes("ticks come late"))) {
      return { kind: "late", head: `Late ticks: the ${surface} feels softer.`, more: `${share}.${late}` };
    }
    const isPassive = this.law === "none" ? "No law. Passive so far." : isTrue ? "Passive." : "Passive, as far as readings tell.";
    const motion = this.moved <= REST ? "At rest." : isContact ? "In contact." : "Moving freely.";
    const ticks = this.frame.misses - this.missedBefore;
    const lasting = !late && this.law !== "none" && ticks * this.period > LASTING ? ` ${ticks} ticks were missed in this contact: let go, and press again.` : "";
    const why = this.reason && this.law !== "none" ? `: ${this.reason.split(": ")[0]}` : "";
    const more = isShort ? `The hand gets ${share}${why}.${lasting}` : isContact ? `The hand gets all ${text(asked)} N.` : "No contact.";
    return { kind: this.law === "none" ? "off" : "passive", head: `${isPassive} ${motion}`, more: more + late };
  }
}

/** The energy that the hand has put in under this law, in J; of real devices what the law estimates. */
function energyOf({ true_energy, energy }) { return true_energy.at(-1) ?? energy.at(-1) ?? 0; }
