"""Several laws and estimators on one recording, as a table and a picture. Writes compared.png.

python examples/compare_laws.py docs/examples/spring.csv
"""

import sys

from foretouch import ContactMap, ExactHuntCrossley, ExactKelvinVoigt, HuntCrossleyLogRLS, KelvinVoigtRLS, compare

if __name__ == "__main__":  # the work is done by several processes
    found = compare(
        sys.argv[1:] or ["docs/examples/spring.csv"],
        estimators=[KelvinVoigtRLS, ExactKelvinVoigt, HuntCrossleyLogRLS, ExactHuntCrossley, ContactMap],
    )
    table = found.to_pandas()
    columns = ["model", "estimator", "residual_percent", "prediction_error_percent", "delayed_force_error_percent"]
    print(table[columns].round(1).to_string(index=False))
    found.plot().savefig("compared.png")
