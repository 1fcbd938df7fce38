"""A folder of photos, looked at by several workers of a Ray cluster; one line of JSON a photo.

python ray_fleet.py photos --hfov 65 --workers 4 --out found.jsonl

Without a cluster (`ray start`, or the variable RAY_ADDRESS) it starts a local one. Workers need the wheel, and must be
able to read the photos. A worker that dies costs time and nothing else.
"""

import argparse
import json
from pathlib import Path

import farsight.ray
import ray

IMAGES = {".jpg", ".jpeg", ".png", ".webp"}


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--hfov", type=float, help="horizontal field of view, degrees; by default photos tell it")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--cores", type=int, default=1, help="of each worker")
    parser.add_argument("--batch", type=int, default=8, help="photos that a worker gets at once")
    parser.add_argument("--model", default="farsight-w")
    parser.add_argument("--out", type=Path, default=Path("found.jsonl"))
    args = parser.parse_args(words)

    photos = sorted(path.resolve() for path in args.folder.iterdir() if path.suffix.lower() in IMAGES)
    if not photos:
        parser.error(f"{args.folder}: no photos in this folder")
    if not ray.is_initialized():
        ray.init()
    blocks = max(1, len(photos) // args.batch)
    dataset = ray.data.from_items([{"path": str(path)} for path in photos], override_num_blocks=blocks)
    found = farsight.ray.map(
        dataset,
        hfov=args.hfov,
        batch_size=args.batch,
        concurrency=args.workers,
        num_cpus=args.cores,
        model=args.model,
    )
    failed = 0
    with args.out.open("w", encoding="utf-8") as lines:
        for row in found.iter_rows():
            failed += row["error"] is not None
            print(row["json"] or json.dumps({"image": row["path"], "error": row["error"]}), file=lines, flush=True)
    print(f"{len(photos) - failed} photos in {args.out}; {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
