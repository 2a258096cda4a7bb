// The server's clock, as seen from a page.

const FORGETS = 1.001; // clocks drift: the best exchange so far counts a little less with each new one

/**
 * How far the server's clock is ahead of `performance.now()`, in ms. Of all exchanges the one that took the least
 * time counts; the error is at most half of that time. Source: D. Mills et al., RFC 5905 (2010), section 8.
 */
export class Clock {
  constructor() {
    this.least = Infinity; // ms
    this.ahead = NaN;
  }

  /** Take note of an exchange, all in ms: sent and back by our clock, heard and told by the server's. */
  note(sent, heard, told, back) {
    const way = back - sent - (told - heard);
    this.least *= FORGETS;
    if (way >= this.least) return;
    this.least = way;
    this.ahead = (heard - sent + told - back) / 2;
  }
}
