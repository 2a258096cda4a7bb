//! A virtual wall that serves a forcebound graph over TCP; written from docs/protocol.md.
//! `wall ADDRESS PORT [STIFFNESS SURFACE [KEY_FILE GRAPH_KEY]]`: the graph listens there; stiffness in
//! N/m, surface in m; KEY_FILE is our NAME.key_secret, GRAPH_KEY a NAME.key or its 40 characters.
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering};
use std::{fs::read_to_string, hash::{BuildHasher, Hasher}, path::Path, str::FromStr, time::Instant};
type Fallible<T> = Result<T, Box<dyn std::error::Error>>;
const SECOND: u64 = 1_000_000_000; // ns
static STOPPED: AtomicBool = AtomicBool::new(false);

#[derive(Deserialize)] struct Header { version: u64 }
#[derive(Deserialize)] // keys that are not here are ignored
struct Query {
    packet: String, seq: u64, time_ns: u64, device_seq: u64, device_time_ns: u64, #[allow(dead_code)] elapsed: f64,
    position: Vec<f64>, velocity: Vec<f64>,
    #[serde(deserialize_with = "Option::deserialize")] // nil, but not missing
    environment: Option<String>,
    #[serde(default = "only_hand")]
    hand: String,
}
fn only_hand() -> String { "hand".into() }

#[derive(Serialize)] struct Reply<'a> {
    packet: &'a str, version: u64, hand: &'a str, seq: u64, time_ns: u64, device_seq: u64, device_time_ns: u64,
    query_seq: u64, query_time_ns: u64, force: Vec<f64>, environment: &'a str,
    proxy: Option<Vec<f64>>, normal: Option<Vec<f64>>,
}

/// Return the query in a message, or the reason why there is none.
fn read(frames: &[Vec<u8>]) -> Fallible<Query> {
    let frame = &frames[0];
    if frames.len() != 1 || frame.len() > 8192 || !matches!(frame.first(), Some(0x80..=0x8f | 0xde | 0xdf)) {
        return Err("malformed: not one map of at most 8192 bytes".into());
    }
    if rmp_serde::from_slice::<Header>(frame)?.version != 5 { return Err("version: this program speaks 5".into()) }
    let mut rest = frame.as_slice();
    let query: Query = rmp_serde::from_read(&mut rest)?;
    let axes = query.position.len();
    let largest = query.seq | query.time_ns | query.device_seq | query.device_time_ns;
    let is_sound = rest.is_empty() && query.packet == "environment_query" && largest >> 63 == 0
        && (1..=6).contains(&axes) && query.velocity.len() == axes && query.environment.as_deref() != Some("");
    if is_sound { Ok(query) } else { Err("trailing bytes, another packet, or a value out of range".into()) }
}

/// Return a key: the characters themselves, or the one named `kind` in a key file.
fn key_of(text: &str, kind: &str) -> Fallible<Vec<u8>> {
    if text.len() == 40 && !Path::new(text).exists() { return Ok(text.into()) }
    let content = read_to_string(text).map_err(|error| format!("{text}: {error}"))?;
    let line = content.lines().find_map(|line| line.trim().strip_prefix(kind));
    Ok(line.and_then(|line| line.split('"').nth(1)).ok_or(format!("{text} has no {kind}"))?.into())
}

/// Return the number that all of a word is, or what was expected.
fn number<T: FromStr + PartialOrd>(word: &str, least: T, most: T, expected: &str) -> Fallible<T> {
    let value = word.parse().ok().filter(|value| (&least..=&most).contains(&value));
    Ok(value.ok_or(format!("expected {expected}, got '{word}'"))?)
}
extern "C" fn stop(_: libc::c_int) { STOPPED.store(true, Ordering::Relaxed) }

fn main() { if let Err(error) = serve() { eprintln!("wall: {error}"); std::process::exit(2) } }

fn serve() -> Fallible<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if ![2, 4, 6].contains(&arguments.len()) { return Err("usage: ADDRESS PORT [STIFFNESS SURFACE [KEY_FILE GRAPH_KEY]]".into()) }
    let word = |place: usize, default| arguments.get(place).map_or(default, String::as_str);
    let (address, port) = (&arguments[0], number(&arguments[1], 1_u16, 65535, "PORT, a whole number from 1 to 65535")?);
    let stiffness = number(word(2, "10000"), 0.0, 1e9, "STIFFNESS in N/m, a number from 0 to 1e9")?;
    let surface = number(word(3, "0.01"), -1.0, 1.0, "SURFACE in m, a number from -1 to 1")?;
    let name = format!("rust-wall-{:016x}", std::collections::hash_map::RandomState::new().build_hasher().finish());
    let context = zmq::Context::new();
    let (socket, endpoint) = (context.socket(zmq::DEALER)?, format!("tcp://{address}:{port}"));
    (socket.set_linger(0)?, socket.set_immediate(true)?, socket.set_ipv6(true)?, socket.set_maxmsgsize(65536)?);
    if let [_, _, _, _, key, graph_key] = &arguments[..] {
        socket.set_curve_serverkey(&key_of(graph_key, "public-key")?)?;
        socket.set_curve_publickey(&key_of(key, "public-key")?)?;
        socket.set_curve_secretkey(&key_of(key, "secret-key")?)?;
    }
    socket.connect(&endpoint)?; // after all of these
    let on_signal = stop as extern "C" fn(libc::c_int) as libc::sighandler_t;
    for signal in [libc::SIGINT, libc::SIGTERM] { unsafe { libc::signal(signal, on_signal) }; }
    println!("{name}: a wall of {stiffness} N/m at {surface} m, for the graph at {endpoint}");
    let start = Instant::now();
    let now = || start.elapsed().as_nanos() as u64;
    let (mut answered, mut dropped, mut serving, mut heard_at, mut answered_at) = (0, 0, None, 0, 0);
    while !STOPPED.load(Ordering::Relaxed) {
        let _ = socket.poll(zmq::POLLIN, 200); // ms; a signal ends it early
        let mut newest = None; // the last readable one of all that wait; a flood cannot keep us taking
        for frames in std::iter::from_fn(|| socket.recv_multipart(zmq::DONTWAIT).ok()).take(1000) {
            if frames == [b""] { continue } // a greeting
            newest = read(&frames).map_err(|reason| {
                dropped += 1;
                if dropped % 1000 == 1 { println!("{name}: dropped {dropped} so far: {reason}") }
            }).ok().or(newest);
        }
        if newest.is_none() { let _ = socket.send("", zmq::DONTWAIT); } // greets: the graph sends to who has sent
        if newest.is_none() && now() - heard_at > 3 * SECOND { // once refused, ZeroMQ does not try again
            println!("{name}: no query for 3 s; is the graph there, and does it let our key in? Its log tells");
            (socket.disconnect(&endpoint)?, socket.connect(&endpoint)?);
            heard_at = now();
        }
        let query = match newest { Some(query) => query, None => continue };
        heard_at = now();
        let refused = matches!(&query.environment, Some(other) if *other != name);
        if serving.as_ref() != Some(&query.environment) {
            let serves = query.environment.as_deref().unwrap_or("nobody");
            println!("{name}: {}{serves} serves the graph", if refused { "refused: " } else { "" });
            serving = Some(query.environment);
        }
        if refused && heard_at - answered_at < SECOND { continue }
        // The wall faces the first axis: f = k (x - x_w) inside, 0 outside and on the other axes.
        let depth = query.position[0] - surface;
        let along = |first: f64, others: &[f64]| [&[first], others].concat();
        let still = vec![0.0; query.position.len() - 1];
        let force = along(stiffness * depth.max(0.0), &still);
        let inside = depth > 0.0; // then it tells the contact: where the tip would be outside, and the way out
        let proxy = inside.then(|| along(surface, &query.position[1..]));
        let reply = Reply { packet: "environment_reply", version: 5, hand: &query.hand, proxy, normal: inside.then(|| along(-1.0, &still)), seq: answered, time_ns: now(), force,
            device_seq: query.device_seq, device_time_ns: query.device_time_ns,
            query_seq: query.seq, query_time_ns: query.time_ns, environment: &name };
        let _ = socket.send(rmp_serde::to_vec_named(&reply)?, zmq::DONTWAIT); // unless nobody takes it
        (answered, answered_at) = (answered + 1, now());
    }
    println!("{name}: {answered} answered, {dropped} dropped");
    Ok(())
}
