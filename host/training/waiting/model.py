import torch, torch.nn as nn, torch.nn.functional as F
# D4 as 2x2 signed permutations on (x,y)
mats=[]
for ex in (0,1):
    for sx in (1,-1):
        for sy in (1,-1):
            m=[[sx,0],[0,sy]] if not ex else [[0,sx],[sy,0]]
            mats.append(m)
M=torch.tensor(mats)
def idx(m):
    for i in range(8):
        if (M[i]==m).all(): return i
MUL=[[idx(M[a]@M[b]) for b in range(8)] for a in range(8)]
def rep(kind):
    # returns perm[h], sign[h]: value v -> (h v)[perm[c]] = sign * v[c]
    perms=[];signs=[]
    for h in range(8):
        p=[];s=[]
        for k in kind:
            o=len(p)
            if k=='v':
                # (h v)_i = sum M[i,j] v_j
                for j in range(2):
                    i=0 if M[h][0][j]!=0 else 1
                    p.append(o+i); s.append(int(M[h][i][j]))
            elif k=='s':
                p.append(o); s.append(1)
            elif k=='r':
                for g in range(8):
                    p.append(o+MUL[h][g]); s.append(1)
        perms.append(torch.tensor(p)); signs.append(torch.tensor(s).float())
    return perms,signs
def orbit(kin,kout,ks):
    """for weight [out,in,ks,ks]: list of (index,sign) such that W = mean_h sign_h * V.flatten()[index_h]"""
    pi,si=rep(kin); po,so=rep(kout)
    I=len(pi[0]); O=len(po[0]); c=(ks-1)/2
    idxs=[];sgs=[]
    o,i,y,x=torch.meshgrid(torch.arange(O),torch.arange(I),torch.arange(ks),torch.arange(ks),indexing='ij')
    for h in range(8):
        px=x-c; py=y-c
        nx=(M[h][0][0]*px+M[h][0][1]*py+c).round().long(); ny=(M[h][1][0]*px+M[h][1][1]*py+c).round().long()
        idxs.append((((po[h][o]*I+pi[h][i])*ks+ny)*ks+nx).flatten())
        sgs.append((so[h][o]*si[h][i]).flatten())
    return torch.stack(idxs),torch.stack(sgs)
class EqW(nn.Module):
    def __init__(s,kin,kout,ks,transposed=False,eq=True):
        super().__init__()
        kl=lambda k:sum({'v':2,'s':1,'r':8}[c] for c in k)
        s.I,s.O,s.ks=kl(kin),kl(kout),ks; s.t=transposed; s.eq=eq
        fan=s.I*ks*ks
        b=(1/fan)**.5
        V=torch.empty(s.O,s.I,ks,ks).uniform_(-b,b)
        if eq:
            ix,sg=orbit(kin,kout,ks); s.register_buffer('ix',ix,False); s.register_buffer('sg',sg,False)
            V=V*8**.5   # averaging over orbits shrinks by sqrt 8
        s.V=nn.Parameter(V)
    def w(s):
        if not s.eq: W=s.V
        else: W=(s.V.flatten()[s.ix]*s.sg).mean(0).view_as(s.V)
        return W.transpose(0,1) if s.t else W
class BN(nn.Module):
    def __init__(s,C,eq):
        super().__init__(); s.C=C; s.eq=eq; n=C//8 if eq else C
        s.bn=nn.BatchNorm2d(n,eps=1e-5)
    def forward(s,x):
        if not s.eq: return s.bn(x)
        B,C,H,W=x.shape
        return s.bn(x.view(B,C//8,8*H,W)).view(B,C,H,W)
class Net(nn.Module):
    def __init__(s,widths=(24,48,64),eq=True,down='2',kin='vsvsvss'):
        super().__init__()
        a,b,c=['r'*(w//8) for w in widths]; A,B,C=widths
        down=str(down); D=[int(c) for c in (down*5 if len(down)==1 else down)]
        mk=lambda i,o,k,t=False: EqW(i,o,k,t,eq)
        s.W=nn.ModuleDict(dict(encode20a=mk(kin,a,D[0]),encode20b=mk(a,a,3),encode10a=mk(a,b,D[1]),encode10b=mk(b,b,3),
          bottom5a=mk(b,c,D[2]),bottom5b=mk(c,c,3),up10=mk(c,b,D[3],True),decode10=mk(b+b,b,3),up20=mk(b,a,D[4],True),decode20=mk(a+a,a,3),output=mk(a,'vs',3)))
        s.N=nn.ModuleDict({k:BN(v.O,eq) for k,v in s.W.items() if k!='output'})
        s.eq=eq
        s.bias=nn.Parameter(torch.zeros(3))
    def st(s,n,x,stride=1):
        w=s.W[n]; k=w.ks
        if stride==2: pad={2:0,3:1,4:1}[k]
        else: pad=1
        return F.relu(s.N[n](F.conv2d(x,w.w(),stride=stride,padding=pad)))
    def up(s,n,x):
        w=s.W[n]; k=w.ks
        pad,op={2:(0,0),3:(1,1),4:(1,0)}[k]
        return F.relu(s.N[n](F.conv_transpose2d(x,w.w(),stride=2,padding=pad,output_padding=op)))
    def forward(s,x):
        e20=s.st('encode20b',s.st('encode20a',x,2))
        e10=s.st('encode10b',s.st('encode10a',e20,2))
        e5=s.st('bottom5b',s.st('bottom5a',e10,2))
        d10=s.st('decode10',torch.cat([s.up('up10',e5),e10],1))
        d20=s.st('decode20',torch.cat([s.up('up20',d10),e20],1))
        b=s.bias*torch.tensor([0.,0.,1.]) if s.eq else s.bias
        return F.conv2d(d20,s.W['output'].w(),padding=1)+b[None,:,None,None]
