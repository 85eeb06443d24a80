//! From finite elements to the reduced model: a basis of modes and of static vectors for each element.

use anyhow::{Context, Result, anyhow};
use nalgebra::{DMatrix, DVector, SMatrix, SVector, SymmetricEigen};
use spanwatch::bridge::{Path, ReducedBridge};
use spanwatch::capacity::{BASIS, FACTORS, PATH_NODES, SENSOR_PLACES};

use super::beam::{Girder, natural_modes};
use super::file::BridgeFile;

/// A candidate for the basis joins it if this part of it, in the mass norm, is new.
const NEW_DIRECTION: f64 = 1e-6;
/// Eigenvalues of an element's share below this part of the whole are rounding.
const NO_STIFFNESS: f64 = 1e-12;

/// Reduces a girder to the logger's basis.
pub fn reduce(file: &BridgeFile) -> Result<ReducedBridge<f64>> {
    let girder = Girder::new(file);
    let stiffness = girder.stiffness(&[]);
    let mechanism = || anyhow!("bridge \"{}\" can move without bending: check its supports", file.name);
    let (lambda, modes) = natural_modes(&stiffness, &girder.mass).ok_or_else(mechanism)?;
    let whole = stiffness.clone().cholesky().ok_or_else(mechanism)?;

    // Modes first, then what bends where one element goes soft, K0^-1 K_e phi_k, for mode after mode.
    let shape = |k: usize| modes.column(k).into_owned();
    let softening = |k: usize| {
        let (shape, whole) = (shape(k), &whole);
        girder
            .element_stiffness
            .iter()
            .map(move |share| whole.solve(&(share * &shape)))
    };
    let candidates = (0..file.basis_modes)
        .map(shape)
        .chain((0..file.basis_modes).flat_map(softening));
    let span = mass_orthonormal(candidates, &girder.mass);
    let n = span.ncols();
    if n < file.basis_modes + file.elements - 1 && n < girder.mass.nrows() {
        return Err(anyhow!(
            "bridge \"{}\" leaves no room for damage in a basis of {BASIS} vectors: take fewer basis_modes",
            file.name
        ));
    }

    // Rotated until the undamaged stiffness is diagonal.
    let (values, rotation) = natural_modes(&(span.transpose() * &stiffness * &span), &DMatrix::identity(n, n))
        .context("the reduced stiffness has no eigenvalues")?;
    let basis = &span * rotation;

    let mut bridge = empty(file, n, &values)?;
    let (w1, w2) = (lambda[0].sqrt(), lambda[1].sqrt());
    // Eqs 35 and 36 with equal ratios at both modes.
    bridge.rayleigh = [
        2.0 * file.damping_ratio * w1 * w2 / (w1 + w2),
        2.0 * file.damping_ratio / (w1 + w2),
    ];

    let scale = DMatrix::from_diagonal(&DVector::from_iterator(
        n,
        values.iter().map(|value| value.sqrt().recip()),
    ));
    for (element, share) in girder.element_stiffness.iter().enumerate() {
        let reduced = &scale * basis.transpose() * share * &basis * &scale;
        let eigen = SymmetricEigen::new((&reduced + reduced.transpose()) * 0.5);
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > NO_STIFFNESS {
                let f = bridge.factor_count;
                if f == FACTORS {
                    return Err(anyhow!(
                        "bridge \"{}\" has more stiffness vectors than {FACTORS}",
                        file.name
                    ));
                }
                bridge
                    .factors
                    .view_mut((0, f), (n, 1))
                    .copy_from(&(vector * value.sqrt()));
                bridge.factor_element[f] = element as u8;
                bridge.factor_count += 1;
            }
        }
    }

    for (node, ([w, slope], &x)) in girder.freedom.iter().zip(&girder.position_m).enumerate() {
        let row = |freedom: &Option<usize>| {
            freedom.map_or(SVector::<f64, BASIS>::zeros(), |f| {
                SVector::from_fn(|k, _| if k < n { basis[(f, k)] } else { 0.0 })
            })
        };
        bridge.path.position_m[node] = x;
        bridge.path.displacement.set_column(node, &row(w));
        bridge.path.slope.set_column(node, &row(slope));
        bridge.sensor_node[node] = node as u16 + 1;
        bridge.sensors.set_column(node, &row(w));
    }
    Ok(bridge)
}

fn empty(file: &BridgeFile, n: usize, values: &[f64]) -> Result<ReducedBridge<f64>> {
    let nodes = file.elements + 1;
    Ok(ReducedBridge {
        name: file
            .name
            .as_str()
            .try_into()
            .map_err(|_| anyhow!("name is longer than 24 bytes"))?,
        basis: n,
        elements: file.elements,
        lambda: SVector::from_fn(|k, _| values.get(k).copied().unwrap_or(0.0)),
        factors: SMatrix::zeros(),
        factor_element: [0; FACTORS],
        factor_count: 0,
        path: Path {
            nodes,
            position_m: [0.0; PATH_NODES],
            displacement: SMatrix::zeros(),
            slope: SMatrix::zeros(),
        },
        sensor_node: [0; SENSOR_PLACES],
        sensors: SMatrix::zeros(),
        sensor_count: nodes,
        rayleigh: [0.0; 2],
    })
}

/// Gram-Schmidt in the mass inner product, twice over, dropping candidates that add no direction, until [`BASIS`] are full.
fn mass_orthonormal(candidates: impl Iterator<Item = DVector<f64>>, mass: &DMatrix<f64>) -> DMatrix<f64> {
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for mut vector in candidates {
        if kept.len() == BASIS {
            break;
        }
        let norm = |v: &DVector<f64>| v.dot(&(mass * v)).sqrt();
        vector /= norm(&vector);
        for _ in 0..2 {
            for other in &kept {
                let along = other.dot(&(mass * &vector));
                vector.axpy(-along, other, 1.0);
            }
        }
        let rest = norm(&vector);
        if rest > NEW_DIRECTION {
            kept.push(vector / rest);
        }
    }
    DMatrix::from_columns(&kept)
}
