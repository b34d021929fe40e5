// Listens to a live run by the official client of the Foxglove WebSocket protocol until it ends, and compares each message with the recording
// of the same run: foxglove.mjs NODE_MODULES ws://ADDRESS FILE.mcap
import { createRequire } from "node:module";
import { readFile } from "node:fs/promises";

const [modules, url, path] = process.argv.slice(2);
const load = createRequire(modules + "/");
const { FoxgloveClient } = load("@foxglove/ws-protocol");
const WebSocket = load("ws");
const { McapStreamReader } = load("@mcap/core");
const { decompress } = load("fzstd");

const check = (holds, what) => {
  if (!holds) throw new Error(what);
};

// A browser's page of another site, and a client of another protocol.
const refused = (protocols, options) =>
  new Promise((done, fail) => {
    const socket = new WebSocket(url, protocols, options);
    socket.on("unexpected-response", (_, response) => done(response.statusCode));
    socket.on("open", () => done("open"));
    socket.on("error", fail);
  });
check((await refused("foxglove.websocket.v1", { origin: "https://elsewhere.example" })) === 403, "another site is refused");
check((await refused("mqtt", {})) === 426, "another protocol is refused");

const socket = new WebSocket(url, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]);
const client = new FoxgloveClient({ ws: socket });
const channels = new Map(), topics = new Map(), heard = new Map(), complaints = [];
client.on("serverInfo", (info) => check(info.name.startsWith("twoport-master"), info.name));
client.on("status", (status) => complaints.push(status.message));
client.on("advertise", (added) => {
  for (const channel of added) {
    check(channel.encoding === "protobuf" && channel.schemaEncoding === "protobuf", channel.encoding);
    channels.set(channel.topic, channel);
    topics.set(client.subscribe(channel.id), channel.topic);
    heard.set(channel.topic, []);
  }
});
client.on("message", ({ subscriptionId, timestamp, data }) =>
  heard.get(topics.get(subscriptionId)).push({ time: timestamp, bytes: Buffer.from(data.buffer, data.byteOffset, data.byteLength) }));
client.on("open", () => {
  socket.send("{");
  socket.send('{"op":"subscribe","subscriptions":[{"id":7,"channelId":99},{"id":-1,"channelId":1}]}');
  socket.send('{"op":"advertise","channels":[]}');
});
await new Promise((done, fail) => {
  client.on("close", done);
  client.on("error", fail);
});
check(complaints.length === 4, `a status for each bad command: ${complaints}`);

const recorded = new Map(), names = new Map(), schemas = new Map();
const reader = new McapStreamReader({ decompressHandlers: { zstd: (bytes, size) => decompress(bytes, new Uint8Array(Number(size))) } });
reader.append(await readFile(path));
for (let record; (record = reader.nextRecord()); ) {
  if (record.type === "Schema") schemas.set(record.id, record);
  if (record.type === "Channel" && !names.has(record.id)) {
    names.set(record.id, record.topic);
    recorded.set(record.topic, new Map());
    const { schemaName, schema } = channels.get(record.topic), own = schemas.get(record.schemaId);
    check(schemaName === own.name && Buffer.from(schema, "base64").equals(Buffer.from(own.data)), `schema of ${record.topic}`);
  }
  if (record.type === "Message") recorded.get(names.get(record.channelId)).set(record.logTime, { number: recorded.get(names.get(record.channelId)).size, bytes: Buffer.from(record.data) });
}
for (const [topic, messages] of heard) {
  const all = recorded.get(topic);
  check(all, `${topic} is in the recording`);
  let before = -1;
  for (const { time, bytes } of messages) {
    const same = all.get(time);
    check(same && same.bytes.equals(bytes), `${topic} at ${time} is as recorded`);
    check(before < 0 || same.number === before + 1, `${topic}: ${same.number} follows ${before}`);
    before = same.number;
  }
  check(topic.endsWith("/header") ? messages.length === 1 : messages.length > 500, `${topic}: ${messages.length} messages`);
}
console.log([...heard].map(([topic, { length }]) => `${topic}: ${length} of ${recorded.get(topic).size}`).join(", "), "as recorded");
