//! Direct solve on the coarsest level: a dense factor of the rest state, warped by the rotations of
//! the nodes, `z = Q M0^-1 Q^T r`, so that nothing is refactored until the topology changes.

use super::operator::Operator;
use crate::fem::lanes::for_packed;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// The factor and the rotations of the nodes.
pub struct Coarsest {
    factor: Option<Cholesky<f64, Dyn>>,
    rotation: Vec<[f64; 9]>,
    buffer: DVector<f64>,
}

impl Coarsest {
    /// Factors the matrix of `operator` at rest, springs left out.
    #[must_use]
    pub fn new(operator: &Operator) -> Self {
        let n = 3 * operator.node_count();
        let mut matrix = DMatrix::<f64>::zeros(n, n);
        for element in 0..operator.element_count() {
            let (nodes, packed) = (operator.element_nodes(element), operator.matrix(element));
            for_packed(|index, row, column| {
                let global = |dof: usize| 3 * nodes[dof / 3] as usize + dof % 3;
                matrix[(global(row), global(column))] += packed[index];
                if row != column {
                    matrix[(global(column), global(row))] += packed[index];
                }
            });
        }
        // Nodes that carry next to nothing make the matrix rank-deficient in f32 entries; a share of
        // the diagonal well above that rounding keeps the factor definite.
        for i in 0..n {
            matrix[(i, i)] = matrix[(i, i)] * (1.0 + 1e-5) + f64::MIN_POSITIVE;
        }
        Self {
            factor: Cholesky::new(matrix),
            rotation: vec![[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]; n / 3],
            buffer: DVector::zeros(n),
        }
    }

    /// Takes the rotation of each node from the elements around it.
    pub fn update_rotations(&mut self, operator: &Operator) {
        self.rotation.iter_mut().for_each(|r| *r = [0.0; 9]);
        for element in 0..operator.element_count() {
            let r = operator.rotation(element);
            for &node in operator.element_nodes(element) {
                (0..9).for_each(|i| self.rotation[node as usize][i] += r[i]);
            }
        }
        for rotation in &mut self.rotation {
            *rotation = orthonormal(rotation);
        }
    }

    /// `x = Q M0^-1 Q^T b`; zero where the matrix could not be factored.
    pub fn solve(&mut self, b: &[[f32; 3]], x: &mut [[f32; 3]]) {
        let Some(factor) = &self.factor else {
            x.iter_mut().for_each(|v| *v = [0.0; 3]);
            return;
        };
        for (node, (r, v)) in self.rotation.iter().zip(b).enumerate() {
            let v = v.map(f64::from);
            for i in 0..3 {
                self.buffer[3 * node + i] = r[i] * v[0] + r[3 + i] * v[1] + r[6 + i] * v[2];
            }
        }
        factor.solve_mut(&mut self.buffer);
        for (node, (r, v)) in self.rotation.iter().zip(x).enumerate() {
            let u = [0, 1, 2].map(|i| self.buffer[3 * node + i]);
            *v = [0, 1, 2].map(|i| (r[3 * i] * u[0] + r[3 * i + 1] * u[1] + r[3 * i + 2] * u[2]) as f32);
        }
    }
}

/// Gram-Schmidt on the rows of a sum of rotations; the identity where they cancel.
pub(super) fn orthonormal(m: &[f64; 9]) -> [f64; 9] {
    let a = crate::Vec3::new(m[0], m[1], m[2]);
    let b = crate::Vec3::new(m[3], m[4], m[5]);
    let (Some(a), true) = (a.try_normalize(1e-6), b.norm() > 1e-6) else {
        return [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    };
    let Some(b) = (b - a * a.dot(&b)).try_normalize(1e-6) else {
        return [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    };
    let c = a.cross(&b);
    [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z]
}
