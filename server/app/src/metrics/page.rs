//! How a metric is written: its help and type, then each of its series.

use std::fmt;

use kerf_session::counts::Durations;
use prometheus_client::encoding::{DescriptorEncoder, EncodeCounterValue, EncodeGaugeValue, NoLabelSet};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::Unit;

/// What is read at a scrape.
pub struct Page<'a>(pub DescriptorEncoder<'a>);

/// A name without its unit, the unit, and what it means.
pub type Head<'a> = (&'a str, Option<Unit>, &'a str);

impl Page<'_> {
    /// A number that only rises; its name ends in `_total`.
    pub fn counter(&mut self, (name, unit, help): Head<'_>, value: impl EncodeCounterValue) -> fmt::Result {
        let mut series = self.0.encode_descriptor(name, help, unit.as_ref(), MetricType::Counter)?;
        series.encode_counter::<NoLabelSet, _, f64>(&value, None)
    }

    /// The same by a label.
    pub fn counters<'v, V: EncodeCounterValue>(
        &mut self,
        (name, unit, help): Head<'_>,
        label: &str,
        values: impl IntoIterator<Item = (&'v str, V)>,
    ) -> fmt::Result {
        let mut all = self.0.encode_descriptor(name, help, unit.as_ref(), MetricType::Counter)?;
        values.into_iter().try_for_each(|(of, value)| {
            all.encode_family(&[(label, of)])?.encode_counter::<NoLabelSet, _, f64>(&value, None)
        })
    }

    /// A number that rises and falls.
    pub fn gauge(&mut self, (name, unit, help): Head<'_>, value: impl EncodeGaugeValue) -> fmt::Result {
        self.0.encode_descriptor(name, help, unit.as_ref(), MetricType::Gauge)?.encode_gauge(&value)
    }

    /// The same, where there is such a thing.
    pub fn gauge_if(&mut self, (name, unit, help): Head<'_>, value: Option<impl EncodeGaugeValue>) -> fmt::Result {
        let mut series = self.0.encode_descriptor(name, help, unit.as_ref(), MetricType::Gauge)?;
        value.map_or(Ok(()), |value| series.encode_gauge(&value))
    }

    /// The same by a label.
    pub fn gauges<S: AsRef<str>, V: EncodeGaugeValue>(
        &mut self,
        (name, unit, help): Head<'_>,
        label: &str,
        values: impl IntoIterator<Item = (S, V)>,
    ) -> fmt::Result {
        let mut all = self.0.encode_descriptor(name, help, unit.as_ref(), MetricType::Gauge)?;
        values.into_iter().try_for_each(|(of, value)| all.encode_family(&[(label, of.as_ref())])?.encode_gauge(&value))
    }

    /// A gauge that is always 1, and says something by its labels.
    pub fn info(&mut self, (name, unit, help): Head<'_>, labels: &[(&str, &str)]) -> fmt::Result {
        let mut all = self.0.encode_descriptor(name, help, unit.as_ref(), MetricType::Gauge)?;
        all.encode_family(&labels)?.encode_gauge(&1u32)
    }

    /// Durations by a label, in seconds.
    pub fn durations(&mut self, (name, help): (&str, &str), label: &str, values: &[(&str, &Durations)]) -> fmt::Result {
        let mut all = self.0.encode_descriptor(name, help, Some(&Unit::Seconds), MetricType::Histogram)?;
        let ends_s = Durations::BOUNDS_NS.map(|bound_ns| bound_ns as f64 * 1e-9).into_iter().chain([f64::INFINITY]);
        values.iter().try_for_each(|(of, durations)| {
            let buckets: Vec<(f64, u64)> = ends_s.clone().zip(durations.buckets()).collect();
            let count = buckets.iter().map(|(_, count)| count).sum();
            let labels = [(label, *of)];
            let mut series = all.encode_family(&labels)?;
            series.encode_histogram::<NoLabelSet>(durations.sum_s(), count, &buckets, None)
        })
    }
}
