"""The face of Sinew, a line for each name; `__init__.py` loads a name from the module that its line says."""

from sinew.analysis.analysed import Analysed as Analysed
from sinew.analysis.analysed import analyse as analyse
from sinew.figures import plot as plot
from sinew.identify.identified import Identified as Identified
from sinew.identify.identified import identify as identify
from sinew.identify.joint.calibration import Calibration as Calibration
from sinew.identify.joint.calibration import calibrate as calibrate
from sinew.identify.oscillator.model import MODELS as MODELS
from sinew.identify.oscillator.model import Model as Model
from sinew.identify.oscillator.record import Record as Record
from sinew.identify.oscillator.record import make_record as make_record
from sinew.measure.errors import FileError as FileError
from sinew.measure.errors import RecordingError as RecordingError
from sinew.measure.errors import SchemaError as SchemaError
from sinew.measure.errors import SinewError as SinewError
from sinew.measure.errors import SpecError as SpecError
from sinew.measure.errors import TimeError as TimeError
from sinew.measure.errors import UnitError as UnitError
from sinew.measure.estimate import Estimate as Estimate
from sinew.measure.files.csv import export_csv as export_csv
from sinew.measure.files.netcdf import export_mat as export_mat
from sinew.measure.files.netcdf import save_recording as save_recording
from sinew.measure.read import read as read
from sinew.plan.parameter import Parameter as Parameter
from sinew.plan.plan import Plan as Plan
from sinew.plan.plan import Pretension as Pretension
from sinew.plan.plan import RingDown as RingDown
from sinew.plan.plan import Sweep as Sweep
from sinew.plan.rig import RigSpec as RigSpec
from sinew.plan.toml import dump_plan as dump_plan
from sinew.plan.toml import dump_rig as dump_rig
from sinew.plan.toml import load_plan as load_plan
from sinew.plan.toml import load_rig as load_rig
from sinew.predict.joints.design import Design as Design
from sinew.predict.joints.design import design_rig as design_rig
from sinew.predict.predicted import Predicted as Predicted
from sinew.predict.predicted import predict as predict
from sinew.tune.design import Designed as Designed
from sinew.tune.design import design as design
from sinew.tune.pretension import Tuning as Tuning
from sinew.tune.pretension import tune as tune
from sinew.twin.parameters import Effects as Effects
from sinew.twin.simulate import simulate as simulate

__version__: str
