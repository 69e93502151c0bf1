"""A recording of `gripline run --record RUN.mcap` as a plot: forces, stick ratio and grip-force line over time.

python recording_to_plot.py RUN.mcap PLOT.png
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import gripline


def main(recording: str, picture: str) -> None:
    read = gripline.read_recording(recording, pictures=False)
    columns = read["columns"]
    t = columns["t_s"]
    figure, (forces, ratio, heat) = plt.subplots(3, 1, figsize=(8, 9), height_ratios=(2, 2, 3), layout="constrained")
    forces.plot(t, columns["fn"], label="normal force")
    forces.plot(t, columns["ft"], label="shear force")
    forces.plot(t, columns["line_n"], label="grip-force line")
    forces.set_ylabel("N")
    forces.legend()
    ratio.plot(t, columns["stick_ratio"], label="stick ratio")
    slips = columns["state"] == "SLIP"
    ratio.plot(t[slips], np.full(slips.sum(), 0.02), "|", color="tab:red", label="SLIP")
    ratio.set(xlabel="s", ylabel="stick ratio", ylim=(0, 1.05), xlim=forces.get_xlim())
    ratio.legend()
    hardest = int(np.argmax(columns["fn"]))
    image = heat.imshow(read["maps"][hardest, 2], origin="lower")
    heat.set_title(f"normal force per taxel at {t[hardest]:.2f} s")
    heat.set(xlabel="column", ylabel="row", xticks=range(0, 20, 5), yticks=range(0, 20, 5))
    figure.colorbar(image, label="N", panchor=False)
    figure.savefig(picture, dpi=120)
    print(f"{len(t)} frames, {slips.sum()} in SLIP: {picture}")


if __name__ == "__main__":
    main(*sys.argv[1:3])
