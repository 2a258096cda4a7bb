// The hands of a graph: their colours, and which of them this page moves and shows in detail.

// Colours of the hands in their order, in every part of the page. Colour-blind people can tell the first four apart.
const COLOURS = ["true", "commanded", "text", "pink", "energy", "second", "sky", "olive"];

/** The name of a parameter that belongs to a hand. */
export const ofHand = (hand, name) => (hand === "hand" ? name : `${hand}.${name}`); // "hand" is an only one

/** The hands of a graph, each with its colour; `described` comes from the server. */
export const coloured = (described) => described.map((hand, i) => ({ ...hand, colour: described.length > 1 ? COLOURS[i] : null }));

/** The choice of a hand, or of all, in an element of the page; the address of the page keeps it. */
export class Choice {
  /** @param changed called when another hand has been chosen */
  constructor(place, changed) {
    Object.assign(this, { place, changed, hands: [] });
  }

  /** Offer the hands of a graph. */
  offer(hands) {
    this.hands = hands;
    this.place.hidden = hands.length < 2;
    this.place.replaceChildren(...[{ name: "", colour: "soft" }, ...hands].map(({ name, colour }) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: name || "all hands", value: name });
      button.style.setProperty("--hand", `var(--${colour})`);
      button.addEventListener("click", () => this.choose(name));
      return button;
    }));
    this.choose(new URLSearchParams(location.search).get("hand") ?? "");
  }

  choose(name) {
    const isKnown = this.hands.length > 1 && this.hands.some((hand) => hand.name === name);
    this.chosen = isKnown ? name : null; // null: all
    for (const button of this.place.children) button.setAttribute("aria-pressed", String(button.value === (this.chosen ?? "")));
    if (this.hands.length > 1) {
      const address = new URL(location);
      if (isKnown) address.searchParams.set("hand", name); else address.searchParams.delete("hand");
      history.replaceState(null, "", address);
    }
    this.changed();
  }

  /** The hands that are shown in detail. */
  get shown() { return this.chosen === null ? this.hands : this.hands.filter(({ name }) => name === this.chosen); }
}
