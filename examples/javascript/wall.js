// A virtual wall that serves a forcebound graph over TCP; written from docs/protocol.md.
// `node wall.js ADDRESS PORT [STIFFNESS SURFACE [KEY_FILE GRAPH_KEY]]`: the graph listens there; stiffness in
// N/m, surface in m; KEY_FILE is our NAME.key_secret, GRAPH_KEY a NAME.key or its 40 characters.
import { randomBytes } from "node:crypto";
import { existsSync, readFileSync } from "node:fs";
import { decode, encode } from "@msgpack/msgpack";
import { Dealer } from "zeromq";

const SECOND = 1_000_000_000n; // ns
const BIG = { useBigInt64: true }; // 64-bit integers as BigInt: a Number spoils the echo

process.on("uncaughtException", (error) => { console.error(`wall: ${error.message}`); process.exit(2); });
const words = process.argv.slice(2);
if (![2, 4, 6].includes(words.length)) throw new Error("usage: ADDRESS PORT [STIFFNESS SURFACE [KEY_FILE GRAPH_KEY]]");

/** Return the number that all of a word is. */
function number(word, least, most, expected, fits = Number.isFinite) {
  const value = word.trim() === "" ? NaN : Number(word);
  if (fits(value) && value >= least && value <= most) return value;
  throw new Error(`expected ${expected}, got '${word}'`);
}

const [address, key, graphKey] = [words[0], words[4], words[5]];
const port = number(words[1], 1, 65535, "PORT, a whole number from 1 to 65535", Number.isInteger);
const stiffness = number(words[2] ?? "10000", 0, 1e9, "STIFFNESS in N/m, a number from 0 to 1e9");
const surface = number(words[3] ?? "0.01", -1, 1, "SURFACE in m, a number from -1 to 1");
const name = `javascript-wall-${randomBytes(8).toString("hex")}`;
const say = (text) => console.log(`${name}: ${text}`);
const now = () => process.hrtime.bigint();

/** Return a key: the characters themselves, or the one named `kind` in a key file. */
function keyOf(text, kind) {
  if (text.length === 40 && !existsSync(text)) return text;
  const found = readFileSync(text, "utf8").match(`${kind} = "(.{40})"`);
  if (!found) throw new Error(`${text} has no ${kind}`);
  return found[1];
}

const options = { linger: 0, immediate: true, ipv6: true, maxMessageSize: 65536, sendTimeout: 0 };
if (key) {
  options.curveServerKey = keyOf(graphKey, "public-key");
  options.curvePublicKey = keyOf(key, "public-key");
  options.curveSecretKey = keyOf(key, "secret-key");
}
const [socket, endpoint] = [new Dealer(options), `tcp://${address}:${port}`];
socket.connect(endpoint);
const unlessNow = (error) => { if (error.code !== "EAGAIN") throw error; }; // nothing came, or nobody takes it

const isCount = (value) => typeof value === "bigint" ? value >= 0n && value < 2n ** 63n
  : Number.isSafeInteger(value) && value >= 0;
const isNumber = (value) => typeof value === "number" || typeof value === "bigint";
const isVector = (value) => Array.isArray(value) && value.length >= 1 && value.length <= 6 && value.every(isNumber);
const isName = (value) => value === null || (typeof value === "string" && value !== "");

/** Return the query in a message, or throw the reason why there is none. */
function read(frames) {
  const [bytes] = frames;
  if (frames.length !== 1 || bytes.length > 8192) throw new Error("malformed: several frames, or over 8192 bytes");
  const query = decode(bytes, BIG); // throws at cut and at trailing bytes
  if (typeof query !== "object" || query === null) throw new Error("malformed: not a map");
  if (!isCount(query.version) || Number(query.version) !== 5) throw new Error(`version ${query.version}: this program speaks 5`);
  if (query.packet !== "environment_query") throw new Error("value: another packet"); // other keys are ignored
  const { seq, time_ns, device_seq, device_time_ns, elapsed, position, velocity, environment } = query;
  if (![seq, time_ns, device_seq, device_time_ns].every(isCount) || ![position, velocity].every(isVector)
    || !isNumber(elapsed) || position.length !== velocity.length || !isName(environment)) {
    throw new Error("value: of another type, or out of range");
  }
  return query;
}

let stopped = false;
for (const signal of ["SIGINT", "SIGTERM"]) process.on(signal, () => { stopped = true; });
let [answered, dropped, serving, heardAt, answeredAt] = [0, 0, undefined, now(), 0n];

/** Wait for a query; take all that wait, and return the last readable one, or nothing. */
async function newest() {
  let query;
  for (let taken = 0; taken < 1000; taken++) { // a flood cannot keep us taking
    socket.receiveTimeout = taken === 0 ? 200 : 0; // ms
    const frames = await socket.receive().catch(unlessNow);
    if (!frames) break;
    if (frames.length === 1 && frames[0].length === 0) continue; // a greeting
    try {
      query = read(frames);
    } catch (reason) {
      if (++dropped % 1000 === 1) say(`dropped ${dropped} so far: ${reason.message}`);
    }
  }
  return query;
}

say(`a wall of ${stiffness} N/m at ${surface} m, for the graph at ${endpoint}`);
while (!stopped) {
  const query = await newest();
  if (!query) await socket.send("").catch(unlessNow); // greets: the graph sends to who has sent
  if (!query && now() - heardAt > 3n * SECOND) { // once refused, ZeroMQ does not try again
    say("no query for 3 s; is the graph there, and does it let our key in? Its log tells");
    socket.disconnect(endpoint), socket.connect(endpoint);
    heardAt = now();
  }
  if (!query) continue;
  heardAt = now();
  const { environment, position, seq, time_ns, device_seq, device_time_ns, hand = "hand" } = query;
  const refused = environment !== null && environment !== name;
  if (environment !== serving) say(`${refused ? "refused: " : ""}${environment ?? "nobody"} serves the graph`);
  serving = environment;
  if (refused && heardAt - answeredAt < SECOND) continue;
  // The wall faces the first axis: f = k (x - x_w) inside, 0 outside and on the other axes.
  const [x, ...across] = position.map(Number);
  const along = (first, others) => [first, ...others]; // a vector: along the first axis, and along the others
  const still = across.map(() => 0);
  const [force, contact] = x > surface // the contact: where the tip would be outside, and the way out
    ? [along(stiffness * (x - surface), still), { proxy: along(surface, across), normal: along(-1, still) }]
    : [along(0, still), { proxy: null, normal: null }];
  await socket.send(encode({ packet: "environment_reply", version: 5, hand, seq: answered++, time_ns: now(), device_seq,
    device_time_ns, query_seq: seq, query_time_ns: time_ns, force, environment: name, ...contact }, BIG))
    .catch(unlessNow);
  answeredAt = now();
}
say(`${answered} answered, ${dropped} dropped`);
socket.close();
