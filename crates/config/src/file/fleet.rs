//! The fleet as it is written: `fleet: { hub: tls://hub.example:4222, credentials: vehicle.nk, ca: ca.pem,
//! max_kbit_s: 512, recordings: on_demand }`.

use std::ops::RangeInclusive;

use crate::decode::{FromNode, Spanned};
use crate::fields::Fields;
use crate::fleet::Recordings;
use telltale_yaml::decode::word;
use telltale_yaml::schema::{default, least, most, pattern, words};
use telltale_yaml::{Log, Members, Node, Schema, Span, key, map};

/// The most that the line carries, in kbit/s.
pub(crate) const KBIT_S: RangeInclusive<u64> = 8..=1_000_000;
pub(crate) const KBIT_S_DEFAULT: u64 = 512;

#[derive(Debug)]
pub(crate) struct RawFleet {
    pub hub: Option<Spanned<HubUrl>>,
    pub credentials: Option<Spanned<String>>,
    pub ca: Option<Spanned<String>>,
    pub max_kbit_s: Option<Spanned<u64>>,
    pub recordings: Option<Recordings>,
    pub span: Span,
}

impl FromNode for RawFleet {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "The fleet that this vehicle tells of itself, by `vehicle.id`; without it, nothing leaves the vehicle.";
        let mut fields = Fields::of(node, map("fleet", "the fleet").about(about), log)?;
        Some(RawFleet {
            hub: fields.required(key("hub").about("The address of the hub: `tls://hub.example:4222`.")),
            credentials: fields.required(
                key("credentials").about(
                    "The file that `telltale fleet enrol` made for this vehicle, relative to this file; only its owner may read it.",
                ),
            ),
            ca: fields.required(
                key("ca").about("The file (PEM) with the certificate of the authority that signed the hub's, relative to this file."),
            ),
            max_kbit_s: fields.optional(
                key("max_kbit_s")
                    .about("The line to the hub carries no more on average.")
                    .rules(|| vec![least(*KBIT_S.start()), most(*KBIT_S.end()), default(KBIT_S_DEFAULT as usize)]),
            ),
            recordings: fields.optional(
                key("recordings")
                    .about("Which recordings of incidents go to the hub: those that the console asks for, each finished one, or none.")
                    .rules(|| vec![default(Recordings::default().as_str())]),
            ),
            span: node.span,
        })
    }
}

impl FromNode for Recordings {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "choice", &Recordings::ALL.map(|it| (it.as_str(), it)))
    }

    fn form(_: &mut Schema) -> Members {
        words(Recordings::ALL.map(Recordings::as_str))
    }
}

/// The address of a hub, which `resolve` checks.
#[derive(Debug, Clone)]
pub(crate) struct HubUrl(pub String);

impl FromNode for HubUrl {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        String::from_node(node, log).map(HubUrl)
    }

    fn form(_: &mut Schema) -> Members {
        pattern("^tls://[^/@]+:[0-9]+$")
    }
}
