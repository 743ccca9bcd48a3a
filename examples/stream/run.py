#!/usr/bin/env python3
"""Reads what `twinrate stream plotjuggler` sends while a drive runs, as PlotJuggler does."""
import json
import pathlib
import socket
import subprocess
import sys
import tempfile

import twinrate

here, out = pathlib.Path(__file__).parent, pathlib.Path(sys.argv[1])
reader = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
reader.bind(("127.0.0.1", 0))
reader.settimeout(1)
stream = subprocess.Popen(["twinrate", "stream", "plotjuggler", "--port", str(reader.getsockname()[1])],
                          stdout=subprocess.PIPE, text=True)
stream.stdout.readline()  # it listens
curves = {"TRUTH": ([], []), "ESTIMATE": ([], [])}
with tempfile.TemporaryDirectory() as runs:
    drive = subprocess.Popen(["twinrate", "launch", here / "drive.toml", "--run-dir", runs + "/run"],
                             stdout=subprocess.DEVNULL)
    while True:
        try:
            message = json.loads(reader.recv(2048))
        except TimeoutError:
            if drive.poll() is not None:
                break
            continue
        for channel in curves.keys() & message.keys():
            if "omega_m_rad_s" in message[channel]:
                curves[channel][0].append(message["timestamp"])
                curves[channel][1].append(message[channel]["omega_m_rad_s"])
stream.terminate()
twinrate.figure("stream: a running drive over UDP", ("speed, rad/s mechanical", "t, s", {
    "true": curves["TRUTH"], "estimated": curves["ESTIMATE"]})).save(out / "picture.svg")
print("both speeds arrived:", all(len(t) > 100 for t, _ in curves.values()))
assert all(len(t) > 100 for t, _ in curves.values())
