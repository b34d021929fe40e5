#!/usr/bin/env python3
"""Puts the playground together: assemble.py PAGE.html CONNECTION.js CORE.wasm SCENES OUT.html"""
import base64
import gzip
import hashlib
import json
import pathlib
import re
import sys

page, connection, core, scenes, out = map(pathlib.Path, sys.argv[1:])
FIRST = ["three_axes", "one_axis", "six_axes", "gripper", "assembly"]


def packed(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


names = sorted((p.stem for p in scenes.glob("*.scene")), key=lambda n: (FIRST.index(n) if n in FIRST else len(FIRST), n))
all_scenes = [
    {
        "name": name,
        "introduction": json.loads((scenes / f"{name}.json").read_text()),
        "values": (scenes / f"{name}.scene").read_bytes().hex(),
    }
    for name in names
]
script = "\n" + connection.read_text()
hash_of_script = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
text = page.read_text()
before, rest = text.split('<script type="module">', 1)
page_script, after = rest.split("</script>", 1)
added = (
    f'<script id="page" type="application/octet-stream">{packed(page_script.encode())}</script>\n'
    f'<script id="core" type="application/octet-stream">{packed(core.read_bytes())}</script>\n'
    f'<script id="scenes" type="application/octet-stream">{packed(json.dumps(all_scenes).encode())}</script>\n'
    f"<script>{script}</script>\n"
)
text = before + after
text = text.replace("script-src ", f"script-src 'wasm-unsafe-eval' 'sha256-{hash_of_script}' ", 1)
text = re.sub(r"connect-src [^;]*;", "connect-src 'none';", text, count=1)
text = text.replace("<body>", "<body>\n" + added, 1)
out.write_text(text)
print(f"{out}: {out.stat().st_size} bytes, {len(names)} scenes")
