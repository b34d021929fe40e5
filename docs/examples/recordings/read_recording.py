#!/usr/bin/env python3
"""Reads a recording of twoport through its index, with Python's standard library, Debian's python3-protobuf and zstd.

    read_recording.py FILE.mcap [TOPIC [FROM_S TO_S]]

Without TOPIC: checks the whole file (footer, summary, CRCs, statistics, every chunk by its index) and prints one line per
channel. With TOPIC: prints its messages, of a part of the recording where two times are given, as JSON.
"""
import ctypes, ctypes.util, struct, sys, zlib

from google.protobuf import descriptor_pb2, descriptor_pool, json_format

try:
    from google.protobuf.message_factory import GetMessageClass
except ImportError:  # before protobuf 4.22
    from google.protobuf.message_factory import MessageFactory

    def GetMessageClass(descriptor):
        return MessageFactory().GetPrototype(descriptor)

MAGIC = b"\x89MCAP0\r\n"


def zstd_decompress(data, size):
    library = ctypes.CDLL(ctypes.util.find_library("zstd") or "libzstd.so.1")
    library.ZSTD_decompress.restype = ctypes.c_size_t
    out = ctypes.create_string_buffer(size)
    got = library.ZSTD_decompress(out, ctypes.c_size_t(size), data, ctypes.c_size_t(len(data)))
    assert got == size, "zstd"
    return out.raw


class Fields:
    def __init__(self, data):
        self.data, self.at = data, 0

    def number(self, form):
        value, = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return value

    def raw(self, size):
        piece = self.data[self.at:self.at + size]
        assert len(piece) == size, "cut off"
        self.at += size
        return piece

    def string(self):
        return self.raw(self.number("I"))

    def map(self, form):
        inner, all = Fields(self.string()), {}
        while inner.at < len(inner.data):
            key = inner.number("H") if form else inner.string().decode()
            all[key] = inner.number(form) if form else inner.string().decode()
        return all

    def records(self):
        while self.at < len(self.data):
            op = self.number("B")
            yield op, Fields(self.raw(self.number("Q")))


class Recording:
    """The index of a file: `schemas`, `channels` (topic, schema, units), `counts`, `chunks`."""

    def __init__(self, path):
        self.file = open(path, "rb")
        assert self.file.read(8) == MAGIC, "no MCAP file"
        self.file.seek(-37, 2)  # footer record and magic
        end = self.file.tell()
        tail = self.file.read()
        assert tail[-8:] == MAGIC and tail[0] == 0x02, "no end: not closed"
        footer = Fields(tail[9:])
        summary_start, _, summary_crc = footer.number("Q"), footer.number("Q"), footer.number("I")
        self.file.seek(summary_start)
        summary = self.file.read(end - summary_start)
        assert zlib.crc32(summary + tail[:25]) == summary_crc, "CRC of the summary"
        self.schemas, self.channels, self.chunks, self.counts, self.messages = {}, {}, [], {}, 0
        for op, f in Fields(summary).records():
            if op == 0x03:
                number, name, _, data = f.number("H"), f.string().decode(), f.string(), f.string()
                self.schemas[number] = (name, data)
            elif op == 0x04:
                number, schema, topic, encoding = f.number("H"), f.number("H"), f.string().decode(), f.string()
                assert encoding == b"protobuf"
                self.channels[number] = (topic, schema, f.map(None))
            elif op == 0x08:
                first, last, at, size = (f.number("Q") for _ in range(4))
                offsets = f.map("Q")
                self.chunks.append((first, last, at, size, offsets))
            elif op == 0x0B:
                self.messages = f.number("Q")
                f.raw(2 + 4 + 4 + 4)
                number_of_chunks = f.number("I")
                self.begin, self.end = f.number("Q"), f.number("Q")
                self.counts = f.map("Q")
        assert number_of_chunks == len(self.chunks), "number of chunks"
        self.classes = {number: self.message_class(*self.schemas[schema])
                        for number, (_, schema, _) in self.channels.items()}

    @staticmethod
    def message_class(name, data):
        pool = descriptor_pool.DescriptorPool()
        for each in descriptor_pb2.FileDescriptorSet.FromString(data).file:
            pool.Add(each)
        return GetMessageClass(pool.FindMessageTypeByName(name))

    def read(self, topic=None, from_ns=0, to_ns=2**63):
        """(channel number, log time in ns, message), through the index of each chunk."""
        for first, last, at, size, offsets in self.chunks:
            if last < from_ns or first > to_ns:
                continue
            self.file.seek(at)
            record = self.file.read(size)
            assert record[0] == 0x06, "no chunk where the index says"
            f = Fields(record[9:])
            f.raw(16)
            full, crc, compression = f.number("Q"), f.number("I"), f.string()
            data = f.raw(f.number("Q"))
            chunk = zstd_decompress(data, full) if compression == b"zstd" else data
            assert zlib.crc32(chunk) == crc, "CRC of a chunk"
            for number, offset in offsets.items():
                if topic is not None and self.channels[number][0] != topic:
                    continue
                self.file.seek(offset)
                assert self.file.read(1) == b"\x07", "no message index where the chunk's index says"
                index = Fields(self.file.read(struct.unpack("<Q", self.file.read(8))[0]))
                assert index.number("H") == number
                entries = Fields(index.string())
                while entries.at < len(entries.data):
                    time, start = entries.number("Q"), entries.number("Q")
                    if not from_ns <= time <= to_ns:
                        continue
                    m = Fields(chunk[start:])
                    assert m.number("B") == 0x05
                    content = Fields(m.raw(m.number("Q")))
                    assert content.number("H") == number
                    content.raw(4)
                    assert content.number("Q") == time
                    yield number, time, self.classes[number].FromString(content.data[22:])


def main(path, topic=None, from_s="0", to_s="1e18"):
    recording = Recording(path)
    if topic is not None:
        limits = [recording.begin + int(float(s) * 1e9) for s in (from_s, to_s)]
        for _, _, message in recording.read(topic, *limits):
            print(json_format.MessageToJson(message, preserving_proto_field_name=True, indent=None))
        return
    counts = dict.fromkeys(recording.channels, 0)
    for number, _, _ in recording.read():
        counts[number] += 1
    assert counts == recording.counts, "statistics"
    assert sum(counts.values()) == recording.messages, "statistics"
    for number, (topic, schema, units) in sorted(recording.channels.items()):
        print(f"{topic}: {counts[number]} messages of {recording.schemas[schema][0]}, units {units}")
    print(f"{(recording.end - recording.begin) * 1e-9:.3f} s in {len(recording.chunks)} chunks")


if __name__ == "__main__":
    main(*sys.argv[1:])
