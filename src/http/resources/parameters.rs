//! The parameters of a job, as the interface names, bounds and explains them.

use serde_json::Value;

use crate::analysis::{JobKind, Parameters};
use crate::http::wire::problem::Problem;
use crate::http::wire::query::{Accepts, Argument, Arguments};

/// Most bases that any configuration may allow.
const BASES_CEILING: u64 = 10_000;

const fn argument(
    name: &'static str,
    accepts: Accepts,
    default: &'static str,
    meaning: &'static str,
) -> Argument {
    Argument { name, alias: None, accepts, default, meaning }
}

/// What the job computes.
pub(crate) const KIND: &[Argument] = &[argument(
    "kind",
    Accepts::Word(&["eigen", "operator"]),
    "eigen",
    "What the job computes: `eigen` builds the operator, then bases and spectrum; `operator` builds and describes the operator, whose matrices can then be fetched.",
)];

/// Place of `bases` among the parameters.
const BASES: usize = 2;

/// The fields of [`Parameters`].
pub(crate) const PARAMETERS: &[Argument] = &[
    argument(
        "operator",
        Accepts::Word(&[
            "pb-mhb",
            "voronoi",
            "pcd",
            "pcd-symmetrized",
            "mesh",
            "cotangent",
            "weighted-graph",
            "graph",
            "kirchhoff",
            "tutte",
        ]),
        "pb-mhb",
        "The discrete Laplace–Beltrami operator. `mesh` and `cotangent` need a cloud with faces.",
    ),
    argument(
        "dimension",
        Accepts::Integer(1, crate::geometry::frames::INTRINSIC_MAX as u64),
        "2",
        "Intrinsic dimension k of what the points sample: 1 for curves, 2 for surfaces, 3 for volumes.",
    ),
    argument(
        "bases",
        Accepts::Integer(1, BASES_CEILING),
        "100",
        "Number of eigenpairs, the zero modes included. At most the number of points, and the service's own limit.",
    ),
    Argument {
        name: "tolerance",
        alias: Some("tol"),
        accepts: Accepts::Range(1e-12, 1e-1),
        default: "1e-4",
        meaning: "Largest relative residual of an eigenpair.",
    },
    argument(
        "t",
        Accepts::Positive,
        "from t_factor",
        "Time of the heat kernel, in squared units of the cloud.",
    ),
    argument("t_factor", Accepts::Positive, "by operator", "The same as a multiple of ε²."),
    argument(
        "delta",
        Accepts::Positive,
        "from delta_factor",
        "Cut-off radius of the heat kernel, or length of a graph's edges, in units of the cloud.",
    ),
    argument(
        "delta_factor",
        Accepts::Positive,
        "by operator",
        "The same as a multiple of √(2t); of ε for graph operators, which have no t.",
    ),
    argument(
        "epsilon",
        Accepts::Positive,
        "estimated",
        "Covering radius ε of the sampling, in units of the cloud, instead of the estimate.",
    ),
    argument(
        "distance",
        Accepts::Word(&["ambient", "projected"]),
        "by parameterization",
        "Distance in the Gaussian of `pcd`: in space, or in the tangent plane of the row's point.",
    ),
    argument(
        "parameterization",
        Accepts::Word(&["covering-radius", "nearest-ten"]),
        "covering-radius",
        "How `pcd` chooses t, δ and its simplices: from the covering radius as in the paper, or from the mean distance to the ten nearest as the authors' own program does.",
    ),
    argument(
        "paper",
        Accepts::Switch,
        "false",
        "Exactly the operator of the PB-MHB paper: switches all additions off that are not set themselves.",
    ),
    argument(
        "isometric_cells",
        Accepts::Switch,
        "not paper",
        "Measure cells by true distances; on surfaces in the triangles around every point, without gaps and holes.",
    ),
    argument(
        "truncation_compensation",
        Accepts::Switch,
        "not paper",
        "Make up for the Gaussian's share beyond the cut-off.",
    ),
    argument(
        "sheet_aware",
        Accepts::Switch,
        "not paper",
        "Couple only neighbors on the same sheet of the surface.",
    ),
    argument(
        "surface_distances",
        Accepts::Switch,
        "not paper",
        "Measure distances in the kernel of `pb-mhb` along the surface; needs `isometric_cells`.",
    ),
    argument(
        "moment_calibration",
        Accepts::Switch,
        "not paper",
        "Scale the kernel of `pb-mhb` so that its second moment is right around every point.",
    ),
    argument(
        "heat_correction",
        Accepts::Switch,
        "not paper",
        "Report λ = −ln(1−tμ)/t as eigenvalues, beside the raw μ of the matrices.",
    ),
];

/// The kind and parameters among `arguments`, checked as far as that goes without a cloud.
///
/// # Errors
/// A problem that names the parameter and what would be accepted.
pub(crate) fn read(arguments: &Arguments, bases_max: usize) -> Result<(JobKind, Parameters), Problem> {
    let kind = match arguments.word("kind") {
        Some("operator") => JobKind::Operator,
        _ => JobKind::Eigen,
    };
    let parameters: Parameters = serde_json::from_value(Value::Object(arguments.of(PARAMETERS)))
        .map_err(|error| Problem::internal(&error))?;
    if parameters.bases > bases_max {
        let bases = Argument { accepts: Accepts::Integer(1, bases_max as u64), ..PARAMETERS[BASES] };
        return Err(bases.refuse(&parameters.bases.to_string()));
    }
    parameters.check()?;
    Ok((kind, parameters))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::operator::OperatorKind;

    #[test]
    fn the_table_names_exactly_the_fields_of_the_parameters() {
        let fields = serde_json::to_value(Parameters::default()).unwrap();
        let fields: BTreeSet<_> = fields.as_object().unwrap().keys().cloned().collect();
        let table: BTreeSet<_> = PARAMETERS.iter().map(|argument| argument.name.to_owned()).collect();
        assert_eq!(table, fields);
    }

    #[test]
    fn the_table_offers_exactly_the_operators_that_exist() {
        let names: Vec<_> = OperatorKind::ALL.iter().map(|kind| kind.name()).collect();
        let Accepts::Word(words) = PARAMETERS[0].accepts else { panic!("operator is a word") };
        assert_eq!(words, names);
    }

    #[test]
    fn the_range_of_the_tolerance_is_that_of_the_check() {
        for (tolerance, accepted) in [(1e-12, true), (0.1, true), (0.9e-12, false), (0.11, false)] {
            let parameters = Parameters { tolerance, ..Parameters::default() };
            assert_eq!(parameters.check().is_ok(), accepted, "{tolerance}");
        }
        let tolerance = PARAMETERS.iter().find(|argument| argument.name == "tolerance").unwrap();
        assert_eq!(tolerance.accepts, Accepts::Range(1e-12, 0.1));
    }

    #[test]
    fn stated_defaults_are_the_defaults() {
        let default = Parameters::default();
        let stated = |name| PARAMETERS.iter().find(|argument| argument.name == name).unwrap().default;
        assert_eq!(stated("bases"), default.bases.to_string());
        assert!((stated("tolerance").parse::<f64>().unwrap() - default.tolerance).abs() < f64::EPSILON);
        assert_eq!(stated("paper"), default.paper.to_string());
        assert_eq!(serde_json::to_value(default.operator).unwrap(), stated("operator"));
        assert_eq!(stated("dimension"), default.dimension.to_string());
        assert_eq!(PARAMETERS[BASES].name, "bases");
    }
}
