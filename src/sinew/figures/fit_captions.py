"""This is where each figure of an identification gets its words."""

from sinew.figures.captions import Caption

__all__ = ["FIT_CAPTIONS"]

FIT_CAPTIONS = {
    "fit_data": Caption(
        "Fit against data",
        "Measured output (grey) and the fitted model's (blue), simulated from the measured input; in red what is left. "
        "Shaded: samples that were held out of the fit, where the line is a prediction. Of one record the whole and "
        "two close-ups, of several segments some periods of each.",
        "",
        "Measured and fitted output over time, with their difference and the held-out part shaded.",
    ),
    "residuals": Caption(
        "Residuals",
        "(a) Measured less fitted over time. (b) Its autocorrelation: the band holds 95 % of the bars where they are "
        "white noise; bars far outside mean that the model misses something, and the intervals above are widened for "
        "it. (c) Size of the residuals in each period against the amplitude there: a trend means a law that depends on "
        "amplitude. (d) Their distribution beside a normal one of the same spread.",
        "",
        "Four panels: residuals over time, autocorrelation with band, size over amplitude, histogram.",
    ),
    "corner": Caption(
        "What is known of the parameters together",
        "On the diagonal each parameter alone, 90 % between the dotted lines; below it the regions that hold 50 % and "
        "90 % of each pair, above it the correlation. A narrow slanting region means that the record tells a "
        "combination of the two better than either. Axes count standard deviations from the value in the title.",
        "",
        "A triangle of panels: distributions of the parameters on the diagonal, regions of pairs below it.",
    ),
    "backbone": Caption(
        "Backbone",
        "Damped frequency and damping ratio of the free swing against its amplitude, with pointwise 90 % bands. Blue: "
        "the fitted model's. Green, where the record is a free decay: from the decay itself, without a model of the "
        "joint. A curve that leaves the other's band speaks against the model.",
        "",
        "Frequency and damping ratio over amplitude, each a line with a band.",
    ),
    "pretension": Caption(
        "Frequency and damping over pretension",
        "Natural frequency and damping ratio of the fitted joint at each pretension of the recording, at the amplitude "
        "it swung with; bars are 90 % intervals.",
        "",
        "Natural frequency and damping ratio over pretension with bars.",
    ),
}
"""By the name of the figure's files, in the order of the page."""
