"""What `import workbench as wb` offers, for editors and type checkers."""

from workbench.analysis.usual import usual_controller as usual_controller
from workbench.api import compare as compare
from workbench.api import diagnose as diagnose
from workbench.api import identify as identify
from workbench.api import load_machine as load_machine
from workbench.api import loop as loop
from workbench.api import open_diagnosis as open_diagnosis
from workbench.api import read_campaign as read_campaign
from workbench.api import replay as replay
from workbench.api import simulate as simulate
from workbench.api import study as study
from workbench.api import tune as tune
from workbench.api import with_effects as with_effects
from workbench.control import PiSettings as PiSettings
from workbench.core.errors import InputError as InputError
from workbench.core.run import Run as Run
from workbench.effects import load_effects as load_effects
from workbench.logs import Campaign as Campaign
from workbench.machines import Hoist as Hoist
from workbench.machines import LinearAxis as LinearAxis
from workbench.machines import RotaryAxis as RotaryAxis
from workbench.machines import default_hoist as default_hoist
from workbench.machines import save_machine as save_machine
from workbench.machines import with_values as with_values
from workbench.references import Limits as Limits
from workbench.references import Step as Step

__version__: str
