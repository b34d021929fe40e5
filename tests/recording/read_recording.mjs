// Reads a recording by @mcap/core through its index: read_recording.mjs NODE_MODULES FILE.mcap
import { createRequire } from "node:module";
import { open } from "node:fs/promises";

const [modules, path] = process.argv.slice(2);
const load = createRequire(modules + "/");
const { McapIndexedReader } = load("@mcap/core");
const { decompress } = load("fzstd");

const file = await open(path);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, size) => {
    const bytes = new Uint8Array(Number(size));
    const { bytesRead } = await file.read(bytes, 0, bytes.length, Number(offset));
    if (bytesRead !== bytes.length) throw new Error(`${bytesRead} of ${bytes.length} bytes at ${offset}`);
    return bytes;
  },
};
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: { zstd: (bytes, size) => decompress(bytes, new Uint8Array(Number(size))) },
});

const check = (holds, what) => {
  if (!holds) throw new Error(what);
};
const counts = new Map();
let before = 0n, all = 0n;
for await (const message of reader.readMessages()) {
  check(message.logTime >= before, "messages come in the order of time");
  before = message.logTime;
  counts.set(message.channelId, (counts.get(message.channelId) ?? 0n) + 1n);
  ++all;
}
const { statistics } = reader;
check(all === statistics.messageCount, `${all} messages, ${statistics.messageCount} by the statistics`);
for (const [id, count] of statistics.channelMessageCounts)
  check((counts.get(id) ?? 0n) === count, `channel ${id}: ${counts.get(id)} messages, ${count} by the statistics`);

// A topic and a time: the ticks of a tenth of a second.
const from = statistics.messageStartTime + 500_000_000n;
const topic = [...reader.channelsById.values()].map((c) => c.topic).find((t) => t.endsWith("/tick"));
let ticks = 0;
for await (const message of reader.readMessages({ topics: [topic], startTime: from, endTime: from + 99_999_999n })) {
  check(message.logTime >= from && message.logTime < from + 100_000_000n, "within the time asked for");
  ++ticks;
}
check(ticks > 0, "a tenth of a second has ticks");
console.log(`@mcap/core: ${all} messages, ${reader.chunkIndexes.length} chunks, ${ticks} of ${topic} in 0.1 s`);
