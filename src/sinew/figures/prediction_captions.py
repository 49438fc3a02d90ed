"""This is where each figure of a prediction gets its words."""

from sinew.figures.captions import Caption

__all__ = ["PREDICTION_CAPTIONS"]

PREDICTION_CAPTIONS = {
    "predicted_response": Caption(
        "Predicted response",
        "(a) Half of peak to peak of the torsion over the amplitude of the drive's command. (b) Lag of the torsion's "
        "fundamental behind the lever's. Colour is pretension. Solid lines are stable, dotted ones are not; rings mark "
        "the peaks, diamonds the folds, where a sweep jumps; dashed lines a gain of one and a lag of 90°.",
        "",
        "Two panels over drive frequency, a line for each pretension: gain on the left, lag on the right.",
    ),
    "predicted_comparison": Caption(
        "Rigs compared",
        "(a) Resonance and (b) gain there over pretension, a line for each rig. Below, each rig's gain over frequency "
        "on equal axes, coloured by pretension; solid lines are stable, dotted ones are not, diamonds are folds.",
        "",
        "Resonance and gain over pretension for all rigs, above a panel of response curves for each.",
    ),
    "predicted_map": Caption(
        "Map of gain",
        "The largest stable gain over frequency and pretension, lines of equal gain in white. The red line is the "
        "resonance; its rings stand at the predicted pretensions, between them the map follows the line.",
        "",
        "Gain as colour over drive frequency and pretension, with a red line along the resonance.",
    ),
    "predicted_bands": Caption(
        "How far the curves can be off",
        "Medians and 90 % bands of rigs drawn from what the calibration knows of the parameters. (a) and (b): what a "
        "sweep with growing frequency meets; dashed edges, where there are folds, what one with falling frequency "
        "meets. (c) Half the width of the gain's band over its median. Assumed parameters do not vary.",
        "",
        "Gain, lag and the half width of the gain's band over drive frequency, a tube for each pretension.",
    ),
    "predicted_against": Caption(
        "Against the recording",
        "(a) and (b): points are measured, bars their 90 % intervals, lines predicted. (c) Error of the predicted gain "
        "at every point. (d) Error of the peak's frequency and gain, both read off the prediction as off the "
        "recording, with the measurement's 90 % intervals. Full marks: pretensions that the rig was calibrated to; "
        "open ones are predictions.",
        "",
        "Measured points and predicted lines of gain and lag, and their differences over frequency and pretension.",
    ),
}
"""By the name of the figure's files, in the order of the page."""
