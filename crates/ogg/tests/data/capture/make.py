"""Makes the clips of this folder with an ffmpeg program: `python make.py FFMPEG`. Needs numpy."""

import hashlib
import pathlib
import subprocess
import sys

import numpy as np

FFMPEG = sys.argv[1]
HERE = pathlib.Path(__file__).parent
WIDTH, HEIGHT, FRAMES = 64, 48, 24


def picture(index: int) -> bytes:
    """Left half grey 40 + 8 i; right half red, green and blue bands; a white mark in the top left corner."""
    rgb = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    rgb[:, : WIDTH // 2] = 40 + 8 * index
    for band, colour in enumerate([(255, 0, 0), (0, 255, 0), (0, 0, 255)]):
        rgb[band * 16 : band * 16 + 16, WIDTH // 2 :] = colour
    rgb[:8, :8] = 255
    return rgb.tobytes()


def run(name: str, *arguments: str, pipe: bytes | None = None) -> None:
    command = [FFMPEG, "-y", "-hide_banner", "-loglevel", "error", *arguments, name]
    subprocess.run(command, input=pipe, check=True, cwd=HERE)


raw = b"".join(picture(i) for i in range(FRAMES))
source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{WIDTH}x{HEIGHT}", "-r", "25", "-i", "-"]
exact = ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1"]


def colour(matrix: str, range_: str) -> list[str]:
    tags = f"colorprim={matrix}:transfer=bt709:colormatrix={matrix}:range={range_}"
    convert = f"scale=out_color_matrix={matrix}:out_range={range_}:flags=accurate_rnd+full_chroma_int"
    return ["-vf", convert, "-x264-params", tags + ":bframes=3:b-pyramid=normal:b-adapt=0:keyint=12:threads=1"]


x264 = ["-c:v", "libx264", "-preset", "slow", "-crf", "12", "-pix_fmt", "yuv420p"]
run("bframes.mp4", *source, *x264, *colour("bt709", "tv"), *exact, pipe=raw)
run("full601.mp4", *source, *x264, *colour("smpte170m", "pc"), "-frames:v", "4", *exact, pipe=raw)
run("fragmented.mp4", "-i", "bframes.mp4", "-c", "copy", "-movflags", "frag_keyframe+empty_moov", *exact)
for turn in (90, 180, 270):
    run(f"rotated{turn}.mp4", "-display_rotation", str(turn), "-i", "full601.mp4", "-c", "copy", *exact)
run("h264-10bit.mp4", *source, "-c:v", "libx264", "-pix_fmt", "yuv422p10le", "-frames:v", "2", *exact, pipe=raw)
run("vp9.mp4", *source, "-c:v", "libvpx-vp9", "-crf", "12", "-b:v", "0", "-vf", "scale=out_color_matrix=bt709:out_range=tv",
    "-colorspace", "bt709", "-pix_fmt", "yuv420p", "-frames:v", "10", *exact, pipe=raw)

version = subprocess.run([FFMPEG, "-version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]
lines = [f'tool = "{version.split(" Copyright")[0]}"', 'command = "python make.py FFMPEG"', "", "[sha256]"]
for file in sorted(HERE.glob("*.mp4")):
    lines.append(f'"{file.name}" = "{hashlib.sha256(file.read_bytes()).hexdigest()}"')
(HERE / "origin.toml").write_text("\n".join(lines) + "\n")
