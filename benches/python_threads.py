"""Pictures a second of one and of two Python threads, each with a renderer of one thread: python benches/python_threads.py SCENE

The GIL is free while a picture is made, so two threads should take little longer than one for twice the pictures.
"""

import sys
import threading
import time

import weather_magician as wm

FRAMES, SIZE = 40, (640, 400)
path = sys.argv[1]
renderers = [wm.Renderer(path, device="cpu", threads=1) for _ in range(2)]
camera = renderers[0].camera(size=SIZE)
weather = wm.Weather("fog")


def work(renderer):
    renderer.render(weather, [camera.viewmat] * FRAMES, [camera.K] * FRAMES, *SIZE)


def wall(count):
    threads = [threading.Thread(target=work, args=(renderer,)) for renderer in renderers[:count]]
    started = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return time.perf_counter() - started


for renderer in renderers:
    work(renderer)
ratios = []
for _ in range(5):
    one, two = wall(1), wall(2)
    ratios.append(2 * one / two)
    print(f"one thread {FRAMES / one:.1f} pictures/s, two {2 * FRAMES / two:.1f}: {ratios[-1]:.2f} times")
print(f"median {sorted(ratios)[len(ratios) // 2]:.2f}")
