// Masking noise, made in the browser.

const LENGTH = 10; // s, then it begins again

/** Return noise of a colour: white, or pink. It starts silent. */
export function noiseOf(colour) {
  const audio = new AudioContext();
  const buffer = audio.createBuffer(1, LENGTH * audio.sampleRate, audio.sampleRate);
  fill(buffer.getChannelData(0), colour);
  const source = new AudioBufferSourceNode(audio, { buffer, loop: true });
  const gain = new GainNode(audio, { gain: 0 });
  source.connect(gain).connect(audio.destination);
  source.start();
  let level = 0, plays = false;
  const update = () => gain.gain.setTargetAtTime(plays ? level ** 2 : 0, audio.currentTime, 0.02); // no click
  return {
    set: (now) => { level = now; update(); },
    play: (now) => { plays = now; update(); },
    stop: () => audio.close(),
  };
}

/** Fill samples; the pink filter is Paul Kellet's, within 0.5 dB of 1/f above 40 Hz at 44.1 kHz. */
export function fill(samples, colour) {
  let a = 0, b = 0, c = 0;
  for (let i = 0; i < samples.length; i++) {
    const white = 2 * Math.random() - 1;
    if (colour === "pink") {
      a = 0.99765 * a + 0.0990460 * white;
      b = 0.96300 * b + 0.2965164 * white;
      c = 0.57000 * c + 1.0526913 * white;
      samples[i] = (a + b + c + 0.1848 * white) / 8;
    } else samples[i] = colour === "white" ? white : 0;
  }
}
